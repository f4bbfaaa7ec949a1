/* From a board's counts to readings, and how well each reading is known. */

#if ELECTRODES
/* The shares of the photocurrent in a detector's electrodes, for a place in half sizes. */
static void electrode_shares(facets_real y, facets_real z, facets_real share[4])
{
#if PINCUSHION
    share[0] = (R(1.0) - y) * (R(1.0) - z) / R(4.0);
    share[1] = (R(1.0) + y) * (R(1.0) - z) / R(4.0);
    share[2] = (R(1.0) - y) * (R(1.0) + z) / R(4.0);
    share[3] = (R(1.0) + y) * (R(1.0) + z) / R(4.0);
#else
    share[0] = (R(1.0) - y) / R(2.0);
    share[1] = (R(1.0) + y) / R(2.0);
    share[2] = (R(1.0) - z) / R(2.0);
    share[3] = (R(1.0) + z) / R(2.0);
#endif
}

static facets_real inside(facets_real x)
{
    return x > R(1.0) ? R(1.0) : x < R(-1.0) ? R(-1.0) : x;
}

/* The variance of a place, in half sizes: of the light that moves away and of that towards. */
static facets_real place_variance(facets_real low, facets_real high, facets_real noise_low,
                                  facets_real noise_high, facets_real light)
{
    const facets_real sum = square(low + high);
    return R(4.0) * (high * high * noise_low + low * low * noise_high) / square(light) / square(sum);
}

/* Weights, one over the standard deviation, of psi, zeta and power, from the electrodes' noise. */
static void weigh_detector(int k, const facets_real one[3], int used, facets_real weights[3])
{
    facets_real share[4], noise[4], light, whole = R(0.0);
    int n;
    weights[0] = weights[1] = weights[2] = R(0.0);
    if (!used) return;
    light = RESPONSIVITY * one[2];
    electrode_shares(inside(one[0] / HALF_SIZES[k][0]), inside(one[1] / HALF_SIZES[k][1]), share);
    for (n = 0; n < 4; n++) {
        noise[n] = SHOT_NOISE * light * facets_fabs(share[n]) + EVEN_NOISE;
        whole += noise[n];
    }
#if PINCUSHION
    weights[0] = place_variance(share[0] + share[2], share[1] + share[3], noise[0] + noise[2],
                                noise[1] + noise[3], light);
    weights[1] = place_variance(share[0] + share[1], share[2] + share[3], noise[0] + noise[1],
                                noise[2] + noise[3], light);
#else
    weights[0] = place_variance(share[0], share[1], noise[0], noise[1], light);
    weights[1] = place_variance(share[2], share[3], noise[2], noise[3], light);
    whole /= R(4.0);
#endif
    weights[0] = R(1.0) / (HALF_SIZES[k][0] * facets_sqrt(weights[0]));
    weights[1] = R(1.0) / (HALF_SIZES[k][1] * facets_sqrt(weights[1]));
    weights[2] = RESPONSIVITY / facets_sqrt(whole);
}

/* The coordinates that four electrodes give, in half sizes, and their sum as one photocurrent. */
static void from_electrodes(const facets_real lit[4], facets_real place[2], facets_real *whole)
{
#if PINCUSHION
    const facets_real low[2] = {lit[0] + lit[2], lit[0] + lit[1]};
    const facets_real high[2] = {lit[1] + lit[3], lit[2] + lit[3]};
    *whole = lit[0] + lit[1] + lit[2] + lit[3];
#else
    const facets_real low[2] = {lit[0], lit[2]}, high[2] = {lit[1], lit[3]};
    *whole = (lit[0] + lit[1] + lit[2] + lit[3]) / R(2.0);
#endif
    place[0] = (high[0] - low[0]) / (high[0] + low[0]);
    place[1] = (high[1] - low[1]) / (high[1] + low[1]);
}

#if GRIDS
/* Which interval of n ascending places x lies in, and where in it: 0 to 1; past an end, the end. */
static int interval(const facets_real *places, int n, facets_real x, facets_real *within)
{
    int k = 0;
    if (!(x > places[0])) x = places[0];
    if (x > places[n - 1]) x = places[n - 1];
    while (k < n - 2 && x > places[k + 1]) k++;
    *within = (x - places[k]) / (places[k + 1] - places[k]);
    return k;
}

static void add_grid(const Grid *grid, const facets_real raw[2], facets_real one[3])
{
    facets_real v, w;
    const int i = interval(grid->y, grid->rows, raw[0], &v);
    const int j = interval(grid->z, grid->columns, raw[1], &w);
    const int at = i * grid->columns + j, below = at + grid->columns;
    const facets_real a = (R(1.0) - v) * (R(1.0) - w), b = (R(1.0) - v) * w, c = v * (R(1.0) - w),
                      d = v * w;
    one[0] += a * grid->add_y[at] + b * grid->add_y[at + 1] + c * grid->add_y[below]
              + d * grid->add_y[below + 1];
    one[1] += a * grid->add_z[at] + b * grid->add_z[at + 1] + c * grid->add_z[below]
              + d * grid->add_z[below + 1];
}
#endif

/* What the calibration adds to a detector's place and power. */
static void correct(int k, facets_real one[3])
{
#if CORRECTED
    const facets_real raw[2] = {one[0], one[1]};
    const facets_real y = raw[0] / HALF_SIZES[k][0], z = raw[1] / HALF_SIZES[k][1];
    const facets_real powers[9] = {y, z, y * y, y * z, z * z, y * y * y, y * y * z, y * z * z,
                                   z * z * z};
    int n;
    for (n = 0; n < 9; n++) {
        one[0] += CORRECTIONS[k][2 + n] * powers[n];
        one[1] += CORRECTIONS[k][11 + n] * powers[n];
    }
    one[2] += CORRECTIONS[k][0] * one[2] + CORRECTIONS[k][1];
#if GRIDS
    if (GRID[k].rows > 0 && finite_number(raw[0]) && finite_number(raw[1]))
        add_grid(&GRID[k], raw, one);
#endif
#else
    (void)k;
    (void)one;
#endif
}

int32_t facets_from_counts(const int32_t *counts, const facets_real *dark, int32_t xy_sum,
                           facets_real *reading)
{
    int32_t read = 0;
    int k, n;
    for (k = 0; k < 3; k++) {
        facets_real lit[4], place[2], whole, *one = reading + 3 * k;
        int full = 0;
        for (n = 0; n < 4; n++) {
            const int32_t count = counts[4 * k + n];
            full |= count >= CONVERTER_TOP || count <= -CONVERTER_TOP;
            lit[n] = (facets_real)count - (dark ? dark[4 * k + n] : R(0.0));
        }
        if (xy_sum) {
            whole = lit[2];
            place[0] = lit[0] / whole;
            place[1] = lit[1] / whole;
        } else {
            from_electrodes(lit, place, &whole);
        }
        one[0] = HALF_SIZES[k][0] * place[0];
        one[1] = HALF_SIZES[k][1] * place[1];
        one[2] = whole / COUNTS_PER_MILLIWATT;
        correct(k, one);
        if (full || !finite_number(one[0] + one[1] + one[2])) {
            one[0] = one[1] = one[2] = FACETS_NAN;
        } else {
            read++;
        }
    }
    return read;
}
#else
/* Weights, one over the standard deviation: a place's grows as one over the power. */
static void weigh_detector(int k, const facets_real one[3], int used, facets_real weights[3])
{
    (void)k;
    weights[0] = weights[1] = used ? one[2] / NOISE_OF_PLACES : R(0.0);
    weights[2] = used ? R(1.0) / POWER_FLOOR : R(0.0);
}

/* This sensor's configuration has no electronics, so that counts have no meaning for it. */
int32_t facets_from_counts(const int32_t *counts, const facets_real *dark, int32_t xy_sum,
                           facets_real *reading)
{
    int n;
    (void)counts;
    (void)dark;
    (void)xy_sum;
    for (n = 0; n < 9; n++) reading[n] = FACETS_NAN;
    return 0;
}
#endif
