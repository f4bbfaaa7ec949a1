/* Feeds the exported solver with anything: under a sanitizer, and a wrong pose ends it with 1. */
#include <math.h>
#include <stdint.h>
#include <stdio.h>

#include "facets.h"
#include "facets_frame.h"

static uint64_t seed = 88172645463325252ull;

static uint64_t next(void)
{
    seed ^= seed << 13;
    seed ^= seed >> 7;
    seed ^= seed << 17;
    return seed;
}

static facets_real anything(void)
{
    static const facets_real ODD[8] = {0, -1, (facets_real)1e30, (facets_real)-1e30,
                                       (facets_real)1e-30, (facets_real)NAN, (facets_real)INFINITY,
                                       (facets_real)-INFINITY};
    const uint64_t n = next();
    if (n % 4 == 0) return ODD[(n >> 8) % 8];
    return (facets_real)((double)(n >> 11) / 9007199254740992.0 - 0.5) * (n % 4 == 1 ? 1 : 20);
}

int main(void)
{
    int n, c, wrong = 0;
    for (n = 0; n < 20000; n++) {
        facets_options options;
        facets_solution found;
        facets_real reading[9], start[9], state[9], dark[12];
        int32_t counts[12];
        uint8_t frame[FACETS_FRAME_SIZE];
        facets_default_options(&options);
        for (c = 0; c < 3; c++) {
            if (next() % 2) options.sigma[c] = anything();
            if (next() % 4 == 0) options.mean[c] = anything();
        }
        options.max_steps = (int32_t)(next() % 60) - 2;
        for (c = 0; c < 9; c++) {
            reading[c] = c % 3 == 2 && next() % 2 ? (facets_real)0.1 : anything();
            start[c] = state[c] = anything();
        }
        for (c = 0; c < 12; c++) {
            counts[c] = (int32_t)(uint32_t)next();
            dark[c] = anything();
        }
        (void)facets_solve(reading, next() % 2 ? start : NULL, &options, &found);
        facets_frame_pose(frame, (uint32_t)n, 0, &found, 1);
        for (c = 0; c < 8; c++) {
            const int finite = isfinite(found.state[c]) != 0;
            wrong += finite != (found.status == FACETS_CONVERGED);
        }
        (void)facets_step(reading, state, &options);
        (void)facets_readings(start, reading);
        (void)facets_from_counts(counts, next() % 2 ? dark : NULL, (int32_t)(next() % 2), reading);
        (void)facets_status_text((int32_t)(next() % 20) - 5);
    }
    printf("%d wrong\n", wrong);
    return wrong > 0;
}
