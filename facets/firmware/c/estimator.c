/* One reading, one estimate: damped Gauss-Newton steps by the normal equations, and in single
 * precision by orthogonal reflections where these have lost too many digits. Rows are in standard
 * deviations. A step of the beam's place takes the mirror along: the equations keep their digits. */

#define UNKNOWNS 9
#define ROWS (9 + 3 + UNKNOWNS)
#define HEAVIEST R(1e12)
#define PATIENCE 10
#define STEPS_IN_THE_DARK 8
#define LEAST_REDUNDANCY R(1e-3)

typedef struct {
    facets_real found[10][10];        /* readings, then their derivatives */
    facets_real columns[10][9];       /* weighted derivatives by unknown; the residuals last */
    facets_real normal[2][9][10];     /* J'J and, in the last column, J'r: here and there */
    facets_real factor[10][9];        /* Cholesky's, its diagonal inverted; the step last */
    facets_real rows[ROWS][10];       /* for the reflections */
    facets_real weights[9];
    facets_real prior[3];             /* 1 / sigma of the beam's place and power */
    facets_real noise_power;
    int free[UNKNOWNS], count;
} Work;

static int known(facets_real sigma) { return !(sigma > R(0.0)); }

/* Weights of one reading, and the detectors that take part. Returns what is wrong, if any. */
static int screen_reading(const facets_real *reading, int32_t used[3], facets_real weights[9])
{
    int status = FACETS_CONVERGED, k;
    for (k = 0; k < 3; k++) {
        const facets_real *one = reading + 3 * k;
        int fault = FACETS_CONVERGED;
        if (!(finite_number(one[0]) && finite_number(one[1]) && finite_number(one[2])))
            fault = FACETS_NON_FINITE;
        else if (!(one[2] > LEAST_LIGHT[0][k]))
            fault = FACETS_NO_LIGHT;
        else if (one[0] < USABLE[k][0] || one[0] > USABLE[k][1]
            || one[1] < USABLE[k][2] || one[1] > USABLE[k][3])
            fault = FACETS_OUT_OF_RANGE;
        used[k] = fault == FACETS_CONVERGED;
        weigh_detector(k, one, used[k], weights + 3 * k);
        if (fault != FACETS_CONVERGED && (status == FACETS_CONVERGED || fault < status))
            status = fault;
    }
    return status;
}

/* By how many the numbers of the detectors used and the priors exceed the unknowns. */
static int count_checks(const Work *work, const int32_t used[3])
{
    int rows = 3 * (used[0] + used[1] + used[2]), j;
    for (j = 6; j < work->count; j++) rows += work->prior[work->free[j] - 6] > R(0.0);
    return rows - work->count;
}

/* What keeps a screened reading from being estimated; FACETS_CONVERGED if nothing does. */
static int refusal(const Work *work, int fault, const int32_t used[3],
                   const facets_options *options)
{
    const int checks = count_checks(work, used);
    if (checks == 0 && !options->accept_unchecked) return FACETS_UNCHECKED;
    return checks >= 0 ? FACETS_CONVERGED : fault;
}

static void ask(Work *work, const facets_options *options)
{
    int c;
    work->count = 0;
    for (c = 0; c < UNKNOWNS; c++) {
        if (c >= 6) {
            const facets_real sigma = options->sigma[c - 6];
            work->prior[c - 6] = known(sigma) || sigma > R(1e30) ? R(0.0) : R(1.0) / sigma;
            if (known(sigma)) continue;
        }
        work->free[work->count++] = c;
    }
}

/* The derivative of a reading by an unknown; the beam's place takes the mirror along. */
static facets_real slope_by(const Work *work, int row, int c)
{
    const facets_real *slopes = work->found[1 + row];
    return c == 6 || c == 7 ? slopes[c] + slopes[c - 6] : slopes[c];
}

/* Fills the weighted columns. Returns the sum of squares of the residuals. */
static facets_real weigh_columns(Work *work, const facets_real *reading)
{
    facets_real total = R(0.0);
    int row, j;
    for (row = 0; row < 9; row++) {
        const facets_real weight = work->weights[row];
        const int taken = weight > R(0.0);
        const facets_real residual = taken ? weight * (reading[row] - work->found[0][row]) : R(0.0);
        for (j = 0; j < work->count; j++)
            work->columns[j][row] = taken ? weight * slope_by(work, row, work->free[j]) : R(0.0);
        work->columns[9][row] = residual;
        total += residual * residual;
    }
    return total;
}

/* Whether a detector that reads light would have none. */
static int is_dark(const Work *work)
{
    int k;
    for (k = 0; k < 3; k++)
        if (work->weights[3 * k] > R(0.0) && !(work->found[0][3 * k + 2] > LEAST_LIGHT[1][k])) return 1;
    return 0;
}

/* The normal equations at x. Returns the sum of squares. */
static facets_real evaluate(Work *work, const facets_wide x[UNKNOWNS], const facets_real *reading,
                            const facets_options *options, int where)
{
    facets_real(*normal)[10] = work->normal[where];
    facets_real total;
    int i, j, row;
    facets_linearise(x, work->found);
    total = weigh_columns(work, reading);
    for (i = 0; i < work->count; i++) {
        for (j = 0; j <= i + 1; j++) {
            const int other = j <= i ? j : 9;
            facets_real sum = R(0.0);
            for (row = 0; row < 9; row++) sum += work->columns[i][row] * work->columns[other][row];
            normal[i][other] = sum;
        }
    }
    for (j = 6; j < work->count; j++) {
        const int c = work->free[j];
        const facets_real weight = work->prior[c - 6];
        const facets_real residual = weight * R(W(options->mean[c - 6]) - x[c]);
        normal[j][j] += weight * weight;
        normal[j][9] += weight * residual;
        total += residual * residual;
    }
    return total;
}

/* Cholesky, the diagonal raised by `damping` of itself. Returns 0 where a pivot is too small. */
static int factorise(Work *work, int where, facets_real damping)
{
    facets_real(*normal)[10] = work->normal[where];
    facets_real(*factor)[9] = work->factor;
    int i, j, k;
    for (j = 0; j < work->count; j++) {
        const facets_real whole = normal[j][j] * (R(1.0) + damping);
        facets_real pivot = whole;
        for (k = 0; k < j; k++) pivot -= factor[j][k] * factor[j][k];
        if (!(pivot > FACETS_SMALLEST_PIVOT * whole)) return 0;
        factor[j][j] = R(1.0) / facets_sqrt(pivot);
        for (i = j + 1; i < work->count; i++) {
            facets_real rest = normal[i][j];
            for (k = 0; k < j; k++) rest -= factor[i][k] * factor[j][k];
            factor[i][j] = rest * factor[j][j];
        }
    }
    return 1;
}

/* The step, into the factor's last row. Returns by how much it lessens the sum of squares. */
static facets_real solve_factored(Work *work, int where)
{
    facets_real(*factor)[9] = work->factor;
    facets_real gain = R(0.0);
    int i, k;
    for (i = 0; i < work->count; i++) {
        facets_real rest = work->normal[where][i][9];
        for (k = 0; k < i; k++) rest -= factor[i][k] * factor[9][k];
        rest *= factor[i][i];
        factor[9][i] = rest;
        gain += rest * rest;
    }
    for (i = work->count - 1; i >= 0; i--) {
        facets_real rest = factor[9][i];
        for (k = i + 1; k < work->count; k++) rest -= factor[k][i] * factor[9][k];
        factor[9][i] = rest * factor[i][i];
    }
    return gain;
}

/* Householder's QR in place, the right-hand side in the column `columns`. Returns 0 where a column
 * is, to rounding, a combination of those before it. */
static int triangularise(facets_real rows[ROWS][10], int high, int columns)
{
    int i, j, k;
    for (j = 0; j < columns; j++) {
        facets_real whole = R(0.0), below = R(0.0), norm, head, scale;
        for (i = 0; i < high; i++) {
            whole += rows[i][j] * rows[i][j];
            if (i >= j) below += rows[i][j] * rows[i][j];
        }
        if (!(below > FACETS_DEPENDENT * whole)) return 0;
        norm = rows[j][j] > R(0.0) ? -facets_sqrt(below) : facets_sqrt(below);
        head = rows[j][j] - norm;
        scale = R(1.0) / (norm * head);
        for (k = j + 1; k <= columns; k++) {
            facets_real along = head * rows[j][k];
            for (i = j + 1; i < high; i++) along += rows[i][j] * rows[i][k];
            along *= scale;
            rows[j][k] += along * head;
            for (i = j + 1; i < high; i++) rows[i][k] += along * rows[i][j];
        }
        rows[j][j] = norm;
    }
    return 1;
}

/* The step by reflections, as `solve_factored` leaves it. Returns -1 where the readings tell none. */
static facets_real reflect(Work *work, const facets_wide x[UNKNOWNS], const facets_real *reading,
                           const facets_options *options, int where, facets_real damping)
{
    facets_real(*rows)[10] = work->rows;
    facets_real gain = R(0.0);
    int i, j, row, high;
    const int columns = work->count;
    facets_linearise(x, work->found); /* the last evaluation may be of a step that was refused */
    (void)weigh_columns(work, reading);
    for (row = 0; row < ROWS; row++)
        for (j = 0; j <= columns; j++) rows[row][j] = R(0.0);
    for (row = 0; row < 9; row++) {
        for (j = 0; j < columns; j++) rows[row][j] = work->columns[j][row];
        rows[row][columns] = work->columns[9][row];
    }
    for (j = 0; j < columns; j++) {
        const int c = work->free[j];
        if (c >= 6) {
            rows[3 + c][j] = work->prior[c - 6];
            rows[3 + c][columns] = work->prior[c - 6] * R(W(options->mean[c - 6]) - x[c]);
        }
        rows[12 + j][j] = facets_sqrt(damping * work->normal[where][j][j]);
    }
    high = 12 + columns;
    if (!triangularise(rows, high, columns)) return R(-1.0);
    for (i = columns - 1; i >= 0; i--) {
        facets_real rest = rows[i][columns];
        for (j = i + 1; j < columns; j++) rest -= rows[i][j] * work->factor[9][j];
        work->factor[9][i] = rest / rows[i][i];
    }
    for (j = 0; j < columns; j++) {
        gain += rows[j][columns] * rows[j][columns];
        for (i = 0; i < j; i++) work->factor[j][i] = rows[i][j];
        work->factor[j][j] = R(1.0) / rows[j][j];
    }
    return gain;
}

/* The sum of squares that rounding of the readings alone can make. */
static facets_real rounding_floor(const facets_real weights[9])
{
    facets_real total = FACETS_SMALL;
    int k;
    for (k = 0; k < 3; k++) {
        total += R(2.0) * square(FACETS_ROUNDING * FARTHEST * weights[3 * k]);
        total += square(FACETS_ROUNDING * BEAM_POWER * weights[3 * k + 2]);
    }
    return total;
}

static void move(const Work *work, const facets_wide from[UNKNOWNS], facets_wide to[UNKNOWNS])
{
    int c, j;
    for (c = 0; c < UNKNOWNS; c++) to[c] = from[c];
    for (j = 0; j < work->count; j++) {
        const int unknown = work->free[j];
        to[unknown] += W(work->factor[9][j]);
        if (unknown == 6 || unknown == 7) to[unknown - 6] += W(work->factor[9][j]);
    }
}

static void copy(const facets_wide from[UNKNOWNS], facets_wide to[UNKNOWNS])
{
    int c;
    for (c = 0; c < UNKNOWNS; c++) to[c] = from[c];
}

/* Whether a used spot reaches past its detector's edge, where it is cut: what then fits the reading
 * need not be the pose. */
static int reaches_edge(const facets_wide x[UNKNOWNS], const int32_t used[3])
{
#if CUTS_AT_EDGES
    facets_real ends[3][5];
    int k;
    spot_ends(x, ends);
    for (k = 0; k < 3; k++) {
        const facets_real y = HALF_SIZES[k][0], z = HALF_SIZES[k][1], *own = ends[k];
        if (used[k] && !(y + own[0] >= R(0.0) && y - own[1] >= R(0.0) && z + own[2] >= R(0.0)
                         && z - own[3] >= R(0.0)))
            return 1;
    }
#else
    (void)x;
    (void)used;
#endif
    return 0;
}

/* Improves x until the sum of squares is least. Returns the status. */
static int estimate(Work *work, facets_wide x[UNKNOWNS], const facets_real *reading,
                    const facets_options *options, int32_t *steps, facets_real *left)
{
    const facets_real small = rounding_floor(work->weights);
    facets_wide trial[UNKNOWNS];
    facets_real damping = R(0.0), earlier, gain;
    facets_real cost = evaluate(work, x, reading, options, 0);
    int here = 0, dark, blind = 0;
    *steps = 0;
    *left = cost;
    if (!(cost < FACETS_HUGE)) return FACETS_OUT_OF_RANGE;
    dark = is_dark(work);
    earlier = cost;
    while (*steps < options->max_steps) {
        *steps += 1;
        if (*steps % PATIENCE == 0) {
            if (cost > R(0.9) * earlier) return FACETS_STALLED;
            earlier = cost;
        }
        gain = factorise(work, here, damping)
                   ? solve_factored(work, here)
                   : reflect(work, x, reading, options, here, damping);
        if (gain < R(0.0)) {
            if (damping > R(0.0)) return FACETS_SINGULAR;
            damping = R(1e-3);
            blind = 1;
            continue;
        }
        if (gain < small && damping > R(0.0)) { /* held back by the damping, not arrived */
            if (blind) return FACETS_SINGULAR;
            damping = R(0.0);
            continue;
        }
        move(work, x, trial);
        if (gain < small) {
            copy(trial, x);
            *left = cost > gain ? cost - gain : R(0.0);
            return FACETS_CONVERGED;
        }
        {
            const facets_real there = evaluate(work, trial, reading, options, 1 - here);
            const facets_real slack =
                small + R(2.0) * facets_sqrt(cost * small) + FACETS_COST_ROUNDING * cost;
            const int into_the_dark = is_dark(work);
            if (there < cost + slack && (dark || !into_the_dark)) {
                copy(trial, x);
                here = 1 - here;
                cost = there;
                dark = into_the_dark;
                blind = 0;
                damping = damping > R(1e-6) ? damping / R(10.0) : R(0.0);
            } else if (damping > HEAVIEST) {
                return FACETS_STALLED;
            } else {
                damping = damping > R(0.0) ? R(10.0) * damping : R(1e-3);
            }
        }
        *left = cost;
        if (dark && *steps >= STEPS_IN_THE_DARK) return FACETS_STALLED;
    }
    return FACETS_MAX_STEPS;
}

/* L^-1 of the unknowns from `first` on, into the rows. */
static void invert_factor(Work *work, int first)
{
    facets_real(*factor)[9] = work->factor;
    facets_real(*inverse)[10] = work->rows;
    int i, j, k;
    for (j = first; j < work->count; j++) {
        inverse[j][j] = factor[j][j];
        for (i = j + 1; i < work->count; i++) {
            facets_real rest = R(0.0);
            for (k = j; k < i; k++) rest += factor[i][k] * inverse[k][j];
            inverse[i][j] = -rest * factor[i][i];
        }
    }
}

/* Whether the readings have hardly any redundancy: their number, plus the fraction of beam and power
 * that the priors determine, minus the number of unknowns. */
static int is_unchecked(Work *work, const int32_t used[3], const facets_options *options)
{
    facets_real redundancy = (facets_real)(3 * (used[0] + used[1] + used[2]) - work->count);
    int i, k;
    invert_factor(work, 6);
    for (i = 6; i < work->count; i++)
        for (k = i; k < work->count; k++)
            redundancy += square(work->prior[work->free[i] - 6] * work->rows[k][i]);
    return redundancy < LEAST_REDUNDANCY && !options->accept_unchecked;
}

/* (L L')^-1 of the unknowns that were asked for, at their places in the state's covariance. */
static void put_covariance(Work *work, facets_real covariance[64])
{
    facets_real(*inverse)[10] = work->rows;
    int i, j, k;
    invert_factor(work, 0);
    for (i = 0; i < work->count; i++) {
        for (j = 0; j <= i; j++) {
            const int a = work->free[i], b = work->free[j];
            facets_real total = R(0.0);
            for (k = i; k < work->count; k++) total += inverse[k][i] * inverse[k][j];
            if (a < 8 && b < 8) covariance[8 * a + b] = covariance[8 * b + a] = total;
        }
    }
    /* the mirror's place is that in the beam and the beam's, added */
    for (i = 0; i < 2; i++) {
        for (j = 0; j < 8; j++) covariance[8 * i + j] += covariance[8 * (i + 6) + j];
        for (j = 0; j < 8; j++) covariance[8 * j + i] += covariance[8 * j + i + 6];
    }
}

static void void_solution(facets_solution *solution)
{
    int n;
    for (n = 0; n < 8; n++) solution->state[n] = FACETS_NAN;
    for (n = 0; n < 64; n++) solution->covariance[n] = FACETS_NAN;
    solution->power = solution->residual = FACETS_NAN;
}

/* Where to begin: what is asked for from `start`, what is known from the means. */
static void begin(const facets_real *reading, const facets_real *start,
                  const facets_options *options, facets_wide x[UNKNOWNS])
{
    int c, k;
    for (c = 0; c < 8; c++) x[c] = start ? W(start[c]) : W(0.0);
    if (!start) {
        x[0] = x[6] = W(options->mean[0]); /* there is light to read only near the beam */
        x[1] = x[7] = W(options->mean[1]);
    }
    for (k = 0; k < 2; k++)
        if (known(options->sigma[k])) x[6 + k] = W(options->mean[k]);
    x[8] = W(options->mean[2]);
    if (known(options->sigma[2])) return;
    if (start) {
        x[8] = W(start[8]);
    } else if (options->sigma[2] > R(1e30)) { /* an unknown power starts from the light seen */
        facets_real seen = R(0.0);
        for (k = 0; k < 3; k++)
            if (finite_number(reading[3 * k + 2])) seen += reading[3 * k + 2];
        if (seen > R(0.0) && finite_number(seen)) x[8] = W(seen);
    }
}

void facets_default_options(facets_options *options)
{
    options->mean[0] = options->mean[1] = R(0.0);
    options->mean[2] = BEAM_POWER;
    options->sigma[0] = options->sigma[1] = FACETS_INFINITY;
    options->sigma[2] = R(0.0);
    options->max_steps = 50;
    options->covariance = 1;
    options->accept_unchecked = 0;
}

int32_t facets_readings(const facets_real *state, facets_real *reading)
{
    facets_wide x[UNKNOWNS];
    facets_real found[10][10];
    int32_t lit = 0;
    int c, k, sound = 1;
    for (c = 0; c < 8; c++) {
        sound = sound && finite_number(state[c]);
        x[c] = W(state[c]);
    }
    x[8] = W(BEAM_POWER);
    facets_linearise(x, found);
    for (k = 0; k < 9; k++) reading[k] = sound ? found[0][k] : FACETS_NAN;
    for (k = 0; k < 3; k++) {
        const facets_real sum = reading[3 * k] + reading[3 * k + 1] + reading[3 * k + 2];
        if (finite_number(sum) && reading[3 * k + 2] > R(0.0)) {
            lit++;
        } else {
            reading[3 * k] = reading[3 * k + 1] = FACETS_NAN;
            if (!finite_number(reading[3 * k + 2])) reading[3 * k + 2] = FACETS_NAN;
        }
    }
    return lit;
}

int32_t facets_solve(const facets_real *reading, const facets_real *start,
                     const facets_options *options, facets_solution *solution)
{
    Work work;
    facets_wide x[UNKNOWNS];
    facets_real left = R(0.0);
    int status, n;
    solution->steps = 0;
    ask(&work, options);
    status = screen_reading(reading, solution->used, work.weights);
    status = refusal(&work, status, solution->used, options);
    if (status == FACETS_CONVERGED) {
        begin(reading, start, options, x);
        status = estimate(&work, x, reading, options, &solution->steps, &left);
        if (status == FACETS_CONVERGED && reaches_edge(x, solution->used))
            status = FACETS_OUT_OF_RANGE;
        if (status == FACETS_CONVERGED && is_unchecked(&work, solution->used, options))
            status = FACETS_UNCHECKED;
    }
    solution->status = status;
    if (status != FACETS_CONVERGED) {
        void_solution(solution);
        return status;
    }
    for (n = 0; n < 8; n++) solution->state[n] = R(x[n]);
    solution->power = R(x[8]);
    solution->residual = facets_sqrt(left);
    for (n = 0; n < 64; n++) solution->covariance[n] = options->covariance ? R(0.0) : FACETS_NAN;
    if (options->covariance) put_covariance(&work, solution->covariance);
    return status;
}

int32_t facets_step(const facets_real *reading, facets_real *state, const facets_options *options)
{
    Work work;
    facets_wide x[UNKNOWNS], trial[UNKNOWNS];
    facets_real cost, gain;
    int32_t used[3];
    int status, c, dark;
    ask(&work, options);
    status = screen_reading(reading, used, work.weights);
    status = refusal(&work, status, used, options);
    if (status != FACETS_CONVERGED) return status;
    begin(reading, state, options, x);
    cost = evaluate(&work, x, reading, options, 0);
    if (!(cost < FACETS_HUGE)) return FACETS_OUT_OF_RANGE;
    dark = is_dark(&work);
    gain = factorise(&work, 0, R(0.0)) ? solve_factored(&work, 0)
                                       : reflect(&work, x, reading, options, 0, R(0.0));
    if (gain < R(0.0)) return FACETS_SINGULAR;
    move(&work, x, trial);
    for (c = 0; c < UNKNOWNS; c++)
        if (!finite_number(R(trial[c]))) return FACETS_OUT_OF_RANGE;
    if (dark) return FACETS_STALLED;
    if (gain < rounding_floor(work.weights) && reaches_edge(trial, used))
        return FACETS_OUT_OF_RANGE;
    if (gain < rounding_floor(work.weights) && is_unchecked(&work, used, options))
        return FACETS_UNCHECKED;
    for (c = 0; c < UNKNOWNS; c++) state[c] = R(trial[c]);
    return gain < rounding_floor(work.weights) ? FACETS_CONVERGED : FACETS_MAX_STEPS;
}

const char *facets_status_text(int32_t status)
{
    switch (status) {
    case FACETS_CONVERGED: return "converged";
    case FACETS_MAX_STEPS: return "max steps";
    case FACETS_SINGULAR: return "singular";
    case FACETS_OUT_OF_RANGE: return "out of range";
    case FACETS_NO_LIGHT: return "no light";
    case FACETS_NON_FINITE: return "non finite";
    case FACETS_STALLED: return "stalled";
    case FACETS_UNCHECKED: return "unchecked";
    default: return "not a status";
    }
}

int32_t facets_real_size(void) { return (int32_t)sizeof(facets_real); }

int32_t facets_solve_plain(const facets_real *reading, const facets_real *start, int32_t beam,
                           facets_real *numbers)
{
    facets_options options;
    facets_solution solution;
    int n;
    facets_default_options(&options);
    if (beam == 1) {
        options.sigma[0] = options.sigma[1] = R(0.0);
        options.mean[0] = start ? start[6] : R(0.0);
        options.mean[1] = start ? start[7] : R(0.0);
    }
    (void)facets_solve(reading, start, &options, &solution);
    for (n = 0; n < 8; n++) numbers[n] = solution.state[n];
    numbers[8] = solution.power;
    numbers[9] = solution.residual;
    for (n = 0; n < 64; n++) numbers[10 + n] = solution.covariance[n];
    for (n = 0; n < 3; n++) numbers[74 + n] = (facets_real)solution.used[n];
    return solution.status;
}
