// Where the light goes at a state: what the scene and the faces draw.
//
// The rays are those of the optics (hit, reflect, flight, land and darkScene of the generated model), so that what is drawn lies where the readings say. Lengths in mm; places
// across the beam in its sigmas, about the beam's centre.

const Light = (() => {
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const along = (p, s, d) => [p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2]];
  const spread = (x, [e, f]) => [0, 1, 2].map((i) => x[0] * e[i] + x[1] * f[i]);

  // The ray through the place x of the beam: where it meets facet k, its direction after it, where
  // it meets the plane of detector k, and there as (psi, zeta).
  function ray(geometry, at, k, x) {
    const origin = along(at.place, 1, spread(x, geometry.spread));
    const direction = along(geometry.direction, 1, spread(x, geometry.light.fan));
    const start = hit(origin, direction, at.apex, at.normals[k]);
    const leaving = reflect(direction, at.normals[k]);
    const length = flight(start, leaving, geometry.centres[k], geometry.axes[k]);
    const spot = land(start, leaving, length, geometry.centres[k], geometry.axes[k]);
    return {origin, start, leaving, length, end: along(start, length, leaving), spot};
  }

  // From the apex outward and across a facet, the light inside the circle of `radius` sigmas: rows
  // of places, the last the arc; none where the circle does not meet the facet.
  function places(q, first, second, radius, rows, columns) {
    const begin = Math.atan2(first[1], first[0]);
    const opening = Math.atan2(
      first[0] * second[1] - first[1] * second[0], first[0] * second[0] + first[1] * second[1]);
    let angles = Array.from({length: columns}, (_, c) => begin + opening * c / (columns - 1));
    const span = (angle) => {
      const u = [Math.cos(angle), Math.sin(angle)], a = u[0] * q[0] + u[1] * q[1];
      const square = a * a - q[0] * q[0] - q[1] * q[1] + radius * radius;
      const root = Math.sqrt(Math.max(square, 0));
      return {u, near: Math.max(-a - root, 0), far: Math.max(-a + root, 0), lit: square > 0};
    };
    const lit = angles.filter((angle) => { const s = span(angle); return s.lit && s.far > 0; });
    if (lit.length < 2) return [];
    if (lit.length < columns) {
      const [low, high] = [lit[0], lit.at(-1)];
      angles = angles.map((_, c) => low + (high - low) * c / (columns - 1));
    }
    const spans = angles.map(span);
    return Array.from({length: rows}, (_, r) => spans.map(({u, near, far}) => {
      const s = near + (far - near) * r / (rows - 1);
      return [q[0] + s * u[0], q[1] + s * u[1]];
    }));
  }

  // Whether light that meets facet k at a point of the world is reflected, and none of it lost at
  // the mirror's rim, its flat top, or an edge's gap.
  function reflects(geometry, at, k, point) {
    const {cut, tip, rim, gap} = geometry.openings;
    if (!cut) return true;
    const from = along(point, -1, at.apex), [x, y] = geometry.normals[k], size = Math.hypot(x, y);
    const outward = at.turn.map((row) => (row[0] * x + row[1] * y) / size);
    const off = dot(from, outward);
    if (off < tip || off > rim) return false;
    return gap === 0 || [k, (k + 1) % 3].every((n) => {
      const edge = at.edges[n], normal = at.normals[k];
      const beside = [
        edge[1] * normal[2] - edge[2] * normal[1], edge[2] * normal[0] - edge[0] * normal[2],
        edge[0] * normal[1] - edge[1] * normal[0]];
      return Math.abs(dot(from, beside)) / Math.hypot(...beside) > gap / 2;
    });
  }

  // All that is drawn at a state (8,) mm, rad:
  //   apex, turn (rows), place     the mirror's and the beam's
  //   q, sides, radius             the facets as the beam sees them, in sigmas; where its light ends
  //   facets[k]                    {lit, grid, irradiance, onFacet, onDetector, spots, sense, ray}
  //     grid[r][c]                 places in the beam; irradiance[r][c] over the beam's largest
  //     onFacet, onDetector        the same places in the world; spots: as (psi, zeta)
  //     apexSpot, beamSpot         where the apex's ray and the beam's central ray land
  //     toBeam(psi, zeta)          the place in the beam whose light falls there
  //     meets                      whether the facet faces the beam and its light the detector
  function drawing(geometry, state, rows = 9, columns = 25) {
    const flat = darkScene(geometry, state);
    const at = geometry.light.options.on ? apparentScene(geometry, flat) : flat;
    const radius = Math.min(2, geometry.openings.radius);
    const facets = [0, 1, 2].map((k) => {
      const central = ray(geometry, at, k, [0, 0]);
      const facing = -dot(geometry.direction, at.normals[k]);
      const towards = dot(central.leaving, geometry.axes[k][0]);
      const meets = facing > 0 && towards > 0 && central.length > 0;
      const grid = meets ? places(at.q, at.sides[k], at.sides[(k + 1) % 3], radius, rows, columns) : [];
      const rays = grid.map((row) => row.map((x) => ray(geometry, at, k, x)));
      const irradiance = grid.map((row, r) => row.map((x, c) =>
        reflects(geometry, at, k, rays[r][c].start) ? Math.exp(-(x[0] * x[0] + x[1] * x[1]) / 2) : 0));
      return {
        meets, facing, towards, length: central.length, lit: grid.length > 0, grid, irradiance,
        onFacet: rays.map((row) => row.map((one) => one.start)),
        onDetector: rays.map((row) => row.map((one) => one.end)),
        spots: rays.map((row) => row.map((one) => one.spot)),
        apexSpot: ray(geometry, at, k, at.q).spot, beamSpot: central.spot,
        toBeam: meets ? inverse(geometry, at, k) : null,
        reflects: (x) =>
          !geometry.openings.cut || reflects(geometry, at, k, ray(geometry, at, k, x).start),
      };
    });
    return {apex: at.apex, turn: at.turn, place: at.place, q: at.q, sides: at.sides, radius, facets};
  }

  // From a detector's plane back to the beam: the map between them is affine for a beam that is
  // collimated, and nearly so for another.
  function inverse(geometry, at, k) {
    const [o, x, y] = [[0, 0], [1, 0], [0, 1]].map((place) => ray(geometry, at, k, place).spot);
    const [a, b, c, d] = [x[0] - o[0], y[0] - o[0], x[1] - o[1], y[1] - o[1]];
    const size = a * d - b * c;
    return (psi, zeta) => [
      (d * (psi - o[0]) - b * (zeta - o[1])) / size, (a * (zeta - o[1]) - c * (psi - o[0])) / size];
  }

  // Whether a place in the beam lies on facet k, seen along the beam.
  function onFacet(drawn, k, x) {
    const [dx, dy] = [x[0] - drawn.q[0], x[1] - drawn.q[1]];
    const u = drawn.sides[k], v = drawn.sides[(k + 1) % 3];
    return u[0] * dy - u[1] * dx >= 0 && dx * v[1] - dy * v[0] >= 0;
  }

  // The bodies of a sensor at rest:
  //   mirror     its facets' normals, the angles of its edges about its axis (rad), its rim (mm)
  //   detectors  centre, axes and half sizes (mm)
  //   beam       direction, diameters and sigmas (mm), rotation (rad), power (mW), and the radius
  //              (sigmas) at which an aperture ends it
  function bodies({apertures, beam, psds}, {axes, centres, direction, normals, openings}) {
    const {diameter_x, diameter_y, rotation, power} = beam, diameter = [diameter_x, diameter_y];
    return {
      mirror: {
        normals, edges: mirrorEdges(normals).map(([x, y]) => Math.atan2(y, x)),
        rim: Math.min(apertures.rim, RIM_MM),
      },
      detectors: psds.map(({size_y, size_z}, k) => (
        {letter: "ABC"[k], centre: centres[k], axes: axes[k], half: [size_y / 2, size_z / 2]})),
      beam: {
        direction, diameter, sigma: diameter.map((each) => each / 4), rotation, power,
        aperture: Math.min(openings.radius, 1e3),
      },
    };
  }

  return {bodies, drawing, onFacet};
})();
