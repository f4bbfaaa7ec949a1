/* Solves the test vectors of this sensor and compares with what facets itself gives for them.
 *
 * Double precision: within 1e-10 mm and 1e-12 rad. Single, and under real light, where
 * facets leaves small terms out of its derivatives: within a tenth of the reading's own standard
 * uncertainty. Statuses must be the same. Prints what was found; ends with 1 where
 * something differs. */
#include <math.h>
#include <stdio.h>

#include "facets.h"
#include "vectors.h"

static double tolerance(int n, int c)
{
    if (facets_real_size() == 4 || VECTORS_OF_REAL_LIGHT) return 0.1 * VECTOR_UNCERTAINTY[n][c];
    return c >= 3 && c < 6 ? 1e-12 : 1e-10;
}

int main(void)
{
    double worst = 0.0;
    int wrong = 0, converged = 0, n, c;
    for (n = 0; n < VECTORS; n++) {
        facets_options options;
        facets_solution found;
        facets_real reading[9];
        facets_default_options(&options);
        if (VECTOR_BEAM_KNOWN[n]) options.sigma[0] = options.sigma[1] = (facets_real)0;
        for (c = 0; c < 9; c++) reading[c] = (facets_real)VECTOR_READING[n][c];
        (void)facets_solve(reading, NULL, &options, &found);
        if (found.status != VECTOR_STATUS[n]) {
            printf("vector %d: status \"%s\" instead of \"%s\"\n", n,
                   facets_status_text(found.status), facets_status_text(VECTOR_STATUS[n]));
            wrong++;
            continue;
        }
        if (found.status != FACETS_CONVERGED) continue;
        converged++;
        for (c = 0; c < 8; c++) {
            const double off = fabs((double)found.state[c] - VECTOR_STATE[n][c]);
            const double allowed = tolerance(n, c);
            if (allowed > 0.0 && off / allowed > worst) worst = off / allowed;
            if (!(off <= allowed)) {
                printf("vector %d: component %d is off by %g; allowed %g\n", n, c, off, allowed);
                wrong++;
            }
        }
    }
    printf("%d vectors, %d with a pose, %d bytes a number: worst error %.3g of what is allowed, "
           "%d wrong\n", VECTORS, converged, (int)facets_real_size(), worst, wrong);
    return wrong > 0;
}
