/* The frames that `facets acquire` reads: counts, and poses that a board has solved. */
#ifndef FACETS_FRAME_H
#define FACETS_FRAME_H

#include "facets.h"

#ifdef __cplusplus
extern "C" {
#endif

/* Auxiliary channels of each sample, from 0 to 15, as `acquire.channels` of the configuration names
   them; set with -DFACETS_CHANNELS=2 for all files that include this one. */
#ifndef FACETS_CHANNELS
#define FACETS_CHANNELS 0
#endif
#if FACETS_CHANNELS < 0 || FACETS_CHANNELS > 15
#error "a frame has 0 to 15 auxiliary channels"
#endif
#define FACETS_FRAME_SIZE (64 + 4 * FACETS_CHANNELS)
#define FACETS_FRAME_ELECTRODES 1 /* counts of four electrodes of each detector */
#define FACETS_FRAME_XY_SUM 2     /* X, Y, SUM and a spare of each detector */
#define FACETS_FRAME_POSE 3       /* what was solved from the sample of the same number */
#define FACETS_FRAME_HEARTBEAT 4  /* to the board: the program that moves the stage lives */

#define FACETS_FRAME_OVERRUN 1   /* samples before this one were lost on the board */
#define FACETS_FRAME_SATURATED 2 /* a converter was at its end */
#define FACETS_FRAME_MARK 4      /* the input for a trigger had an edge since the last sample */
#define FACETS_FRAME_PERMIT 8    /* the input for the permit is on: the stage may move */

#define FACETS_HEARTBEAT_SIZE 12

/* Hears the heartbeats of the program that moves the stage. Zero it before the first call. */
typedef struct {
    uint8_t bytes[FACETS_HEARTBEAT_SIZE];
    uint8_t held;   /* bytes of a frame that has begun */
    uint8_t alive;  /* the last heartbeat said that the stage may move */
    uint32_t count; /* its number */
    uint32_t heard; /* when it came, us */
} facets_heartbeat;

/* A byte that the program has sent.  now: us. */
void facets_heartbeat_feed(facets_heartbeat *heartbeat, uint8_t byte, uint32_t now);

/* Whether a new heartbeat came within `patience`, us, and said that the stage may move. To be asked
   at every sample; once it was not so, only another heartbeat makes it so again. */
int facets_heartbeat_is_alive(facets_heartbeat *heartbeat, uint32_t now, uint32_t patience);

/* kind: electrodes or X, Y, SUM.  seq: the sample's number.  time: us.  counts: 12. The auxiliary
   channels have no value (NaN) until facets_frame_channels gives them one. */
void facets_frame_counts(uint8_t *frame, uint8_t kind, uint8_t flags, uint32_t seq, uint32_t time,
                         const int32_t *counts);

/* solution: of the sample `seq`.  microseconds: that solving it took. */
void facets_frame_pose(uint8_t *frame, uint32_t seq, uint32_t time,
                       const facets_solution *solution, uint16_t microseconds);

/* Puts the values of the auxiliary channels into a frame of counts; NaN: no value. */
void facets_frame_channels(uint8_t *frame, const float *channels);

#ifdef __cplusplus
}
#endif
#endif
