/* The light in a wedge of a Gaussian beam, by primitives of which the optics is made.
 *
 * All in units of the beam's sigma, about the beam's centre. q is the wedge's point, u a unit
 * vector along one of its sides, a = q . u, h = q x u.
 */

static facets_real square(facets_real x) { return x * x; }

/* half_normal[k]: a polynomial in what z = 4 / (4 + a) is from the middle of its sixteenth. */
static void half_normal(facets_real a, facets_real found[3])
{
    const facets_real z = R(4.0) / (R(4.0) + a);
    int k = (int)(R(16.0) * z);
    facets_real x, sum, share;
    int n;
    if (k > 15) k = 15;
    if (k < 0) k = 0;
    x = R(16.0) * z - (facets_real)k - R(0.5);
    sum = HALF_NORMAL[k][10];
    for (n = 9; n >= 0; n--) sum = sum * x + HALF_NORMAL[k][n];
    found[2] = sum * z * z * z;
    share = R(1.0) / (R(1.0) + a * a);
    found[0] = (found[2] + a) * share;
    found[1] = (R(1.0) - a * found[2]) * share;
}

/* The mass that a side sweeps over while its end moves straight from the beam's centre to q: a
 * Taylor series with the tails of a Poisson distribution. */
static facets_real swept(facets_real a, facets_real h, facets_real along, facets_real across,
                         facets_real beyond, facets_real within)
{
    const int wide = facets_fabs(a) >= facets_fabs(h);
    const facets_real larger = wide ? a : h, smaller = wide ? h : a;
    facets_real poisson = wide ? along : across;
    facets_real x, t, total;
    if (!(facets_fabs(larger) > R(0.0))) return R(0.0);
    x = larger * larger / R(2.0);
    t = smaller / larger;
    if (x > R(40.0)) {
        total = facets_atan2(t, R(1.0));
    } else {
        const facets_real minus = -t * t;
        facets_real power = t, tail = R(1.0) - poisson;
        int j = 0;
        total = t * tail;
        while ((poisson > FACETS_LAST_TERM || (facets_real)j < x) && j < 400) {
            j++;
            poisson *= x / (facets_real)j;
            tail -= poisson;
            power *= minus;
            total += power * tail / (facets_real)(2 * j + 1);
        }
    }
    total /= R(6.283185307179586);
    return wide ? beyond * within / R(4.0) + total : within / R(4.0) - total;
}

/* found: the integrals of 1, s and s^2 along a side, and the mass that it sweeps over. */
static void side_of(facets_real a, facets_real h, facets_real density, facets_real found[4])
{
    const facets_real along = facets_exp(-a * a / R(2.0)), across = facets_exp(-h * h / R(2.0));
    const facets_real beyond = facets_erfc(a * R(0.7071067811865476));
    const facets_real within = facets_erf(h * R(0.7071067811865476));
    found[0] = across * beyond * R(0.19947114020071635);
    if (a > R(1.5)) {
        facets_real integrals[3];
        half_normal(a, integrals);
        found[1] = density * integrals[1];
        found[2] = density * integrals[2];
    } else {
        found[1] = density - a * found[0];
        found[2] = found[0] - a * found[1];
    }
    found[3] = swept(a, h, along, across, beyond, within);
}

static void facets_side_near(facets_real a, facets_real h, facets_real found[4])
{
    side_of(a, h, facets_exp(-(a * a + h * h) / R(2.0)) * R(0.15915494309189535), found);
}

static void facets_side_far(facets_real qx, facets_real qy, facets_real ux, facets_real uy,
                            facets_real a, facets_real found[4])
{
    const facets_real density = facets_exp(-(qx * qx + qy * qy) / R(2.0)) * R(0.15915494309189535);
    side_of(a, qx * uy - qy * ux, density, found);
}

/* A wedge that holds little light: the brighter side, and sums of positive terms over slices that
 * are parallel to it. near: whether that side runs well towards the beam's centre first. */
typedef struct {
    facets_real a, h, ux, uy, sense, light, scale;
    int near;
} Side;

static Side side_from(facets_real qx, facets_real qy, facets_real ux, facets_real uy,
                      facets_real sense)
{
    Side side;
    side.a = qx * ux + qy * uy;
    side.h = qx * uy - qy * ux;
    side.ux = ux;
    side.uy = uy;
    side.sense = sense;
    side.near = side.a < R(-1.0);
    if (side.near) {
        side.light = facets_exp(-side.a * side.a / R(2.0)) * R(0.15915494309189535);
        side.scale = facets_exp(-side.h * side.h / R(2.0));
    } else {
        side.light = R(0.15915494309189535);
        side.scale = facets_exp(-(qx * qx + qy * qy) / R(2.0));
    }
    return side;
}

static void add_moments(facets_real sums[6], facets_real weight, const facets_real i[3],
                        facets_real r)
{
    sums[0] += weight * i[0];
    sums[1] += weight * i[1];
    sums[2] += weight * r * i[0];
    sums[3] += weight * i[2];
    sums[4] += weight * r * i[1];
    sums[5] += weight * r * r * i[0];
}

static void slices_from_point(facets_real a, facets_real h, facets_real c, facets_real s,
                              facets_real sums[6])
{
    const facets_real a2 = a * c + h * s;
    facets_real end = R(76.0) / (facets_sqrt(a2 * a2 + R(76.0)) + a2);
    int k;
    if (a + end * c < R(0.0)) {
        const facets_real beside = (facets_sqrt(h * h + R(76.0) + a * a) - h) / s;
        const facets_real meets = -a / c;
        if (meets < end) end = meets;
        if (beside > end) end = beside;
    }
    for (k = 0; k < 24; k++) {
        const facets_real r = end * SLICES[k][0], start = a + r * c;
        facets_real i[3];
        half_normal(facets_fabs(start), i);
        if (start < R(0.0)) {
            i[0] = R(2.5066282746310002) * facets_exp(start * start / R(2.0)) - i[0];
            i[1] = R(1.0) - start * i[0];
            i[2] = i[0] - start * i[1];
        }
        add_moments(sums, end * s * SLICES[k][1] * facets_exp(-r * (a2 + r / R(2.0))), i, r);
    }
}

static void slices_from_foot(facets_real a, facets_real h, facets_real c, facets_real s,
                             facets_real sums[6])
{
    const facets_real end = R(76.0) / (facets_sqrt(h * h + R(76.0)) + h), slope = c / s;
    int k;
    for (k = 0; k < 24; k++) {
        const facets_real r = end * SLICES[k][0], start = a + r * slope;
        facets_real i[3], table[3];
        i[1] = facets_exp(-start * start / R(2.0));
        half_normal(facets_fabs(start), table);
        i[0] = i[1] * table[0];
        if (start < R(0.0)) i[0] = R(2.5066282746310002) - i[0];
        i[2] = i[0] + start * i[1];
        add_moments(sums, end * R(0.15915494309189535) * SLICES[k][1]
                              * facets_exp(-r * (h + r / R(2.0))), i, r);
    }
}

/* Adds the mass, the first and the second moments of a wedge with cosine c and sine s. */
static void add_slices(const Side *side, facets_real c, facets_real s, facets_real shift_x,
                       facets_real shift_y, facets_real total[6])
{
    facets_real sums[6] = {R(0.0), R(0.0), R(0.0), R(0.0), R(0.0), R(0.0)};
    const facets_real x1 = side->ux, y1 = side->uy, h = -side->sense * side->h;
    facets_real x2, y2, scale, m, p, r, px, py;
    if (side->near) {
        slices_from_foot(side->a, h, c, s, sums);
        scale = R(1.0);
        x2 = -side->sense * y1;
        y2 = side->sense * x1;
    } else {
        slices_from_point(side->a, h, c, s, sums);
        scale = side->light;
        x2 = c * x1 - side->sense * s * y1;
        y2 = c * y1 + side->sense * s * x1;
    }
    m = scale * sums[0];
    p = scale * sums[1];
    r = scale * sums[2];
    px = p * x1 + r * x2;
    py = p * y1 + r * y2;
    total[0] += m;
    total[1] += px + m * shift_x;
    total[2] += py + m * shift_y;
    total[3] += scale * (sums[3] * x1 * x1 + R(2.0) * sums[4] * x1 * x2 + sums[5] * x2 * x2)
                + R(2.0) * px * shift_x + m * shift_x * shift_x;
    total[4] += scale * (sums[3] * x1 * y1 + sums[4] * (x1 * y2 + y1 * x2) + sums[5] * x2 * y2)
                + px * shift_y + py * shift_x + m * shift_x * shift_y;
    total[5] += scale * (sums[3] * y1 * y1 + R(2.0) * sums[4] * y1 * y2 + sums[5] * y2 * y2)
                + R(2.0) * py * shift_y + m * shift_y * shift_y;
}

static void no_light(facets_real found[8])
{
    int n;
    found[0] = R(0.0);
    for (n = 1; n < 8; n++) found[n] = FACETS_NAN;
}

/* found: mass; centroid; 1 - covariance as xx, xy, yy; centroid - q. */
static void facets_quadrature_or_dark(facets_real qx, facets_real qy, facets_real u1x, facets_real u1y,
                                 facets_real u2x, facets_real u2y, facets_real found[8])
{
    const facets_real opening = facets_atan2(u1x * u2y - u1y * u2x, u1x * u2x + u1y * u2y);
    const int second = qx * u2x + qy * u2y < qx * u1x + qy * u1y;
    const Side side = second ? side_from(qx, qy, u2x, u2y, R(-1.0))
                             : side_from(qx, qy, u1x, u1y, R(1.0));
    facets_real sums[6] = {R(0.0), R(0.0), R(0.0), R(0.0), R(0.0), R(0.0)};
    facets_real cx, cy;
    if (!(square(qx) + square(qy) < R(1e6)) || !(side.scale > R(0.0)) || !(opening > R(0.0))) {
        no_light(found);
        return;
    }
    if (opening <= R(2.3)) {
        add_slices(&side, facets_cos(opening), facets_sin(opening), R(0.0), R(0.0), sums);
    } else {
        const facets_real c = facets_cos(opening / R(2.0)), s = facets_sin(opening / R(2.0));
        Side other = second ? side_from(qx, qy, u1x, u1y, R(1.0))
                            : side_from(qx, qy, u2x, u2y, R(-1.0));
        other.near = 0;
        other.light = side.light;
        other.scale = side.scale;
        add_slices(&side, c, s, R(0.0), R(0.0), sums);
        if (side.near) {
            add_slices(&other, c, s, side.a * side.ux, side.a * side.uy, sums);
        } else {
            add_slices(&other, c, s, R(0.0), R(0.0), sums);
        }
    }
    found[0] = side.scale * sums[0];
    if (!(found[0] > R(0.0))) {
        no_light(found);
        return;
    }
    cx = sums[1] / sums[0];
    cy = sums[2] / sums[0];
    found[3] = R(1.0) - sums[3] / sums[0] + cx * cx;
    found[4] = cx * cy - sums[4] / sums[0];
    found[5] = R(1.0) - sums[5] / sums[0] + cy * cy;
    if (side.near) {
        found[1] = side.h * side.uy + cx;
        found[2] = -side.h * side.ux + cy;
        found[6] = cx - side.a * side.ux;
        found[7] = cy - side.a * side.uy;
    } else {
        found[1] = qx + cx;
        found[2] = qy + cy;
        found[6] = cx;
        found[7] = cy;
    }
}
