/* The frames of 64 bytes that `facets acquire` reads: counts, and poses that a board has solved. */
#ifndef FACETS_FRAME_H
#define FACETS_FRAME_H

#include "facets.h"

#ifdef __cplusplus
extern "C" {
#endif

#define FACETS_FRAME_SIZE 64
#define FACETS_FRAME_ELECTRODES 1 /* counts of four electrodes of each detector */
#define FACETS_FRAME_XY_SUM 2     /* X, Y, SUM and a spare of each detector */
#define FACETS_FRAME_POSE 3       /* what was solved from the sample of the same number */

#define FACETS_FRAME_OVERRUN 1   /* samples before this one were lost on the board */
#define FACETS_FRAME_SATURATED 2 /* a converter was at its end */

/* kind: electrodes or X, Y, SUM.  seq: the sample's number.  time: us.  counts: 12. */
void facets_frame_counts(uint8_t *frame, uint8_t kind, uint8_t flags, uint32_t seq, uint32_t time,
                         const int32_t *counts);

/* solution: of the sample `seq`.  microseconds: that solving it took. */
void facets_frame_pose(uint8_t *frame, uint32_t seq, uint32_t time,
                       const facets_solution *solution, uint16_t microseconds);

#ifdef __cplusplus
}
#endif
#endif
