/* Prints how many instructions a solve and a step take, by the system timer of QEMU's -icount. */
#include <stdint.h>
#include <stdio.h>

#include "facets.h"
#include "vectors.h"

#define TIMER ((volatile uint32_t *)0xe000e010u)
#define TICK 40 /* instructions: 25 MHz of a processor with one instruction each ns */
#define TIMES 32

static uint32_t ticks(void) { return 0xffffffu - TIMER[2]; }

int main(void)
{
    facets_options options;
    facets_solution found;
    facets_real reading[9], state[9], solved[9];
    uint32_t begin, solve, warm, step;
    int n;
    TIMER[1] = 0xffffff;
    TIMER[2] = 0;
    TIMER[0] = 5;
    facets_default_options(&options);
    for (n = 0; n < 9; n++) reading[n] = (facets_real)VECTOR_READING[0][n];
    begin = ticks();
    for (n = 0; n < TIMES; n++) (void)facets_solve(reading, NULL, &options, &found);
    solve = (ticks() - begin) & 0xffffffu;
    for (n = 0; n < 8; n++) solved[n] = found.state[n];
    solved[8] = found.power;
    printf("steps %d\n", (int)found.steps);
    options.covariance = 0;
    begin = ticks();
    for (n = 0; n < TIMES; n++) (void)facets_solve(reading, solved, &options, &found);
    warm = (ticks() - begin) & 0xffffffu;
    begin = ticks();
    for (n = 0; n < TIMES; n++) {
        int c;
        for (c = 0; c < 9; c++) state[c] = solved[c];
        (void)facets_step(reading, state, &options);
    }
    step = (ticks() - begin) & 0xffffffu;
    printf("solve %lu\nwarm %lu\nstep %lu\n", (unsigned long)(solve * TICK / TIMES),
           (unsigned long)(warm * TICK / TIMES), (unsigned long)(step * TICK / TIMES));
    return 0;
}
