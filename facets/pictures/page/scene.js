// The rig as an object in space: mirror head, detectors, laser, base plate, and the light on them.
//
//   const scene = Rig.create(element, RIG, {theme: "dark", onPick, onDrag});
//   scene.update(Model.drawing(state), readings);   // the drawing of light.js; nine readings or null
//   scene.look("rig" | "mirror" | "A" | "B" | "C"); scene.theme("light"); scene.dispose();
//   scene.orbit(left, up, closer);                  // the camera, by angles (rad) and a factor
//   scene.draw(); scene.copy(pen, wide);            // what is seen, with its labels, on another canvas
//
// RIG: see scripts.py and Light.bodies; `element` gets a canvas, labels and buttons of views, and may change
// its size. below(): how many pixels of its lower edge something covers. onPick(name): of a part that was clicked. onDrag(vector, turning): the mirror was dragged
// along a vector of the world, or is to turn about it, in halves of the picture's height; without
// onDrag, or while `scene.mode` is "view", all drags turn the camera.
// `create` returns null where there is no WebGL. Lengths in mm, z up, the world frame of the model.

const Rig = (() => {
  const HEAD = 12, LASER = 110;  // the head's length below its rim, the laser's height; mm
  const V = (a) => new THREE.Vector3(...a);

  const THEMES = {
    dark: {
      plate: "#2c323b", holes: "#101317", metal: "#d6dde5", black: "#30353d", body: "#454d59",
      board: "#1f6a5c", silicon: "#2a3a6b", beam: "#fff1d0", line: "#9aa5b1",
      sky: "#8d9bb0", floor: "#2a2f37", key: 3.4, fill: 0.9, fog: "#0f1216",
    },
    light: {
      plate: "#c8ced6", holes: "#8d95a0", metal: "#d5dbe2", black: "#2b2f36", body: "#3b414a",
      board: "#1d5c50", silicon: "#27335c", beam: "#8a6a00", line: "#4a535e",
      sky: "#ffffff", floor: "#b9c0c9", key: 2.4, fill: 1.1, fog: "#f6f7f9",
    },
  };

  function create(element, rig, options = {}) {
    const canvas = document.createElement("canvas");
    // asked for here, because three.js writes to the console where there is none
    const context = canvas.getContext("webgl2", {
      alpha: true, antialias: true, preserveDrawingBuffer: true});  // kept, to be saved as a picture
    return context && new View(element, rig, new THREE.WebGLRenderer({canvas, context}), options);
  }

  // Bodies that do not change with the theme but in colour: each material by the name of its colour.
  function materials() {
    const made = {};
    const add = (name, metalness, roughness, more = {}) => {
      made[name] = new THREE.MeshStandardMaterial({metalness, roughness, ...more});
    };
    add("plate", 0.35, 0.62);
    add("holes", 0.1, 0.9);
    add("metal", 1.0, 0.28);
    add("black", 0.55, 0.42);
    add("body", 0.6, 0.38);
    add("board", 0.1, 0.6);
    add("silicon", 0.5, 0.16);
    made.line = new THREE.MeshBasicMaterial();
    made.facets = [0, 1, 2].map(() => new THREE.MeshStandardMaterial({
      metalness: 1, roughness: 0.07, flatShading: true, side: THREE.DoubleSide}));
    made.gold = new THREE.MeshStandardMaterial({color: "#d8b25a", metalness: 1, roughness: 0.3});
    made.hues = [0, 1, 2].map(() => new THREE.MeshStandardMaterial({metalness: 0.45, roughness: 0.4}));
    return made;
  }

  function mesh(geometry, material, shadows = true) {
    const made = new THREE.Mesh(geometry, material);
    made.castShadow = made.receiveShadow = shadows;
    return made;
  }

  // A cylinder along z from `low` to `high`.
  function rod(radius, low, high, material, sides = 48, top = radius) {
    const made = mesh(new THREE.CylinderGeometry(top, radius, high - low, sides), material);
    made.rotation.x = Math.PI / 2;
    made.position.z = (low + high) / 2;
    const held = new THREE.Group();
    held.add(made);
    return held;
  }

  function box(x, y, z, material, place = [0, 0, 0]) {
    const made = mesh(new THREE.BoxGeometry(x, y, z), material);
    made.position.set(...place);
    return made;
  }

  // A plate with rounded corners and a bevel, `depth` thick along its own -x, its face at x = 0.
  function slab(halfY, halfZ, depth, radius, material) {
    const shape = new THREE.Shape();
    const [a, b, r] = [halfY, halfZ, radius];
    shape.moveTo(-a + r, -b).lineTo(a - r, -b).quadraticCurveTo(a, -b, a, -b + r)
      .lineTo(a, b - r).quadraticCurveTo(a, b, a - r, b).lineTo(-a + r, b)
      .quadraticCurveTo(-a, b, -a, b - r).lineTo(-a, -b + r).quadraticCurveTo(-a, -b, -a + r, -b);
    const bevel = Math.min(0.4, depth / 4);
    const solid = new THREE.ExtrudeGeometry(shape, {
      depth: depth - 2 * bevel, bevelSize: bevel, bevelThickness: bevel, bevelSegments: 2});
    solid.translate(0, 0, -depth + bevel);
    // (y, z, outward) of the shape to the world's (x outward, y, z)
    solid.applyMatrix4(new THREE.Matrix4().set(0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 0, 1));
    return mesh(solid, material);
  }

  // The mirror in its own frame, the apex at the origin: three facets, a bevel in the three hues,
  // the shaft and its clamp.
  function head(rig, look) {
    const group = new THREE.Group(), {rim, normals, edges} = rig.mirror;
    const height = (x, y) => Math.min(...normals.map((n) => -(n[0] * x + n[1] * y) / n[2]));
    const point = (angle, radius) => {
      const [x, y] = [radius * Math.cos(angle), radius * Math.sin(angle)];
      return [x, y, height(x, y)];
    };
    const lowest = Math.min(...Array.from({length: 180}, (_, n) => point(n * Math.PI / 90, rim)[2]));
    const foot = lowest - HEAD, bevel = 0.06 * rim;
    normals.forEach((_, k) => {
      const begin = edges[k], turn = 2 * Math.PI;
      const opening = ((edges[(k + 1) % 3] - begin) % turn + turn) % turn;
      const arc = Array.from({length: 33}, (_, n) => begin + opening * n / 32);
      const inner = arc.map((angle) => point(angle, rim - bevel));
      const outer = arc.map((angle) => {
        const [x, y, z] = point(angle, rim - bevel);
        return [x * rim / (rim - bevel), y * rim / (rim - bevel), z - 1.2 * bevel];
      });
      const low = outer.map(([x, y]) => [x, y, foot]);
      const fan = inner.slice(1).flatMap((p, n) => [0, 0, 0, ...inner[n], ...p]);
      group.add(mesh(surface(fan), look.facets[k]));
      group.add(mesh(strip(inner, outer), look.hues[k]));
      group.add(mesh(strip(outer, low), look.metal));
    });
    group.add(rod(rim, foot - 0.01, foot, look.metal));
    group.add(rod(0.55 * rim, foot - 14, foot, look.metal));
    group.add(rod(1.5 * rim, foot - 8, foot - 4, look.black));
    group.foot = foot - 14;
    return group;
  }

  function surface(points) {
    const made = new THREE.BufferGeometry();
    made.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
    made.computeVertexNormals();
    return made;
  }

  // Between two rows of points.
  function strip(one, other) {
    const points = one.slice(1).flatMap((p, n) =>
      [...one[n], ...other[n], ...p, ...p, ...other[n], ...other[n + 1]]);
    return surface(points);
  }

  // A detector in its own frame: x away from the mirror, y sideways, z up; its face at the origin.
  function detector(one, hue, look) {
    const group = new THREE.Group(), [y, z] = one.half;
    const face = box(0.3, 2 * y, 2 * z, look.silicon, [0.15, 0, 0]);
    const frame = slab(y + 1.1, z + 1.1, 0.5, 0.5, hue);
    frame.rotation.z = Math.PI;
    frame.position.x = 0.1;
    const body = slab(y + 4, z + 4, 3, 1.2, look.black);
    body.rotation.z = Math.PI;
    body.position.x = 0.5;
    const board = slab(y + 8, z + 8, 1.6, 1.5, look.board);
    board.rotation.z = Math.PI;
    board.position.x = 3.6;
    group.add(face, frame, body, board);
    for (const side of [-1, 1]) {
      for (let n = 0; n < 5; n++) {
        const pin = mesh(new THREE.CylinderGeometry(0.35, 0.35, 3, 10), look.gold);
        pin.rotation.z = Math.PI / 2;
        pin.position.set(6, side * (y + 2.5), (n - 2) * 0.4 * z);
        group.add(pin);
      }
    }
    group.add(box(7, 10, z + 6, look.body, [8.5, 0, -z / 2 - 4]));
    return group;
  }

  // Additive light on dark, ink on light: one strip along a beam, as wide as the beam is, but never
  // thinner than some pixels; brightest along its middle.
  function ribbon() {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(
      new Float32Array([0, -1, 0, 0, 1, 0, 1, -1, 0, 1, 1, 0]), 3));
    geometry.setIndex([0, 2, 1, 1, 2, 3]);
    const material = new THREE.ShaderMaterial({
      transparent: true, depthWrite: false, side: THREE.DoubleSide,
      uniforms: {
        start: {value: V([0, 0, 0])}, end: {value: V([0, 0, 1])}, radius: {value: 0.4},
        least: {value: 5.0}, size: {value: new THREE.Vector2(1, 1)}, scale: {value: 1},
        colour: {value: new THREE.Color()}, strength: {value: 1}, hot: {value: 0},
      },
      vertexShader: `
        uniform vec3 start, end; uniform float radius, least, scale; uniform vec2 size;
        varying float across;
        void main() {
          vec4 a = projectionMatrix * viewMatrix * vec4(start, 1.0);
          vec4 b = projectionMatrix * viewMatrix * vec4(end, 1.0);
          float near = 0.2;
          if (a.w < near && b.w > near) a = mix(a, b, (near - a.w) / (b.w - a.w));
          if (b.w < near && a.w > near) b = mix(b, a, (near - b.w) / (a.w - b.w));
          vec2 run = (b.xy / b.w - a.xy / a.w) * size;
          vec2 side = length(run) > 0.0 ? normalize(vec2(-run.y, run.x)) : vec2(0.0, 1.0);
          vec4 c = position.x < 0.5 ? a : b;
          float wide = max(1.7 * radius * scale / c.w, least);
          c.xy += side * position.y * wide * 2.0 / size * c.w;
          across = 1.7 * position.y;
          gl_Position = c;
        }`,
      fragmentShader: `
        uniform vec3 colour; uniform float strength, hot; varying float across;
        void main() {
          float g = exp(-2.0 * across * across);
          gl_FragColor = vec4(mix(colour, vec3(1.0), hot * g * strength), g * strength);
          #include <colorspace_fragment>
        }`,
    });
    const made = new THREE.Mesh(geometry, material);
    made.frustumCulled = false;
    return made;
  }

  // Light as a body or on a surface: triangles whose corners have their own strength.
  function glow(offset) {
    const material = new THREE.ShaderMaterial({
      transparent: true, depthWrite: false, side: THREE.DoubleSide, polygonOffset: offset,
      polygonOffsetFactor: -2, polygonOffsetUnits: -4,
      uniforms: {colour: {value: new THREE.Color()}, strength: {value: 1}, hot: {value: 0}},
      vertexShader: `
        attribute float light; varying float shine;
        void main() {
          shine = light;
          gl_Position = projectionMatrix * modelViewMatrix * vec4(position, 1.0);
        }`,
      fragmentShader: `
        uniform vec3 colour; uniform float strength, hot; varying float shine;
        void main() {
          float a = clamp(shine * strength, 0.0, 1.0);
          gl_FragColor = vec4(mix(colour, vec3(1.0), hot * a * a), a);
          #include <colorspace_fragment>
        }`,
    });
    const made = new THREE.Mesh(new THREE.BufferGeometry(), material);
    made.frustumCulled = false;
    return made;
  }

  function fill(body, points, light, index) {
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points.flat()), 3));
    geometry.setAttribute("light", new THREE.BufferAttribute(new Float32Array(light), 1));
    geometry.setIndex(index);
    body.geometry.dispose();
    body.geometry = geometry;
    body.visible = index.length > 0;
  }

  function quads(rows, columns, stride = columns, next = stride) {
    const index = [];
    for (let r = 0; r < rows; r++) {
      for (let c = 0; c + 1 < columns; c++) {
        const n = r * stride + c;
        index.push(n, n + 1, n + next, n + 1, n + next + 1, n + next);
      }
    }
    return index;
  }

  // Sheets from a facet to its detector, one for each row of the light's grid: together a body of
  // light, brighter towards the beam's middle.
  function sheets(body, facet) {
    const rows = facet.grid.length, columns = rows ? facet.grid[0].length : 0;
    const points = [], light = [], index = [];
    for (let r = 1; r < rows; r++) {
      const first = points.length;
      points.push(...facet.onFacet[r], ...facet.onDetector[r]);
      light.push(...facet.irradiance[r], ...facet.irradiance[r]);
      index.push(...quads(1, columns).map((n) => n + first));
    }
    fill(body, points, light, index);
  }

  function lit(body, facet, places) {
    const rows = facet.grid.length, columns = rows ? facet.grid[0].length : 0;
    fill(body, places.flat(), facet.irradiance.flat(), quads(rows - 1, columns));
  }

  function surroundings(renderer, colours) {
    const room = new THREE.Scene();
    room.background = new THREE.Color(colours.floor);
    const panel = (colour, strength, size, place) => {
      const made = new THREE.Mesh(new THREE.PlaneGeometry(...size), new THREE.MeshBasicMaterial({
        color: new THREE.Color(colour).multiplyScalar(strength), side: THREE.DoubleSide}));
      made.position.set(...place);
      made.lookAt(0, 0, 0);
      room.add(made);
    };
    panel("#ffffff", 3.2, [6, 6], [0, 0, 8]);
    panel("#dfeaff", 1.8, [3, 7], [8, 3, 3]);
    panel("#fff1de", 1.6, [3, 7], [-6, -6, 3]);
    panel(colours.sky, 1.0, [18, 8], [0, 10, 3]);
    const maker = new THREE.PMREMGenerator(renderer);
    const made = maker.fromScene(room, 0.03).texture;
    maker.dispose();
    return made;
  }

  // Where the base plate lies: below all detectors and the mirror's stage.
  function floorOf(rig) {
    const lowest = Math.min(...rig.detectors.map((one) => one.centre[2] - one.half[1]));
    return Math.min(lowest - 30, -60);
  }

  class View {
    constructor(element, rig, renderer, options) {
      Object.assign(this, {ended: new AbortController(), element, rig, renderer, options, look_: materials(), labels: [], parts: []});
      this.mode = options.onDrag ? "move" : "view";
      renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2));
      renderer.shadowMap.enabled = true;
      renderer.shadowMap.type = THREE.PCFShadowMap;
      renderer.toneMapping = THREE.ACESFilmicToneMapping;
      element.append(renderer.domElement);
      this.scene = new THREE.Scene();
      this.camera = new THREE.PerspectiveCamera(30, 1, 1, 4000);  // near and far follow in `draw`
      this.camera.up.set(0, 0, 1);
      this.reach = Math.max(...rig.detectors.map((one) => Math.hypot(one.centre[0], one.centre[1])));
      this.floor = floorOf(rig);
      this.build();
      this.controls = new THREE.OrbitControls(this.camera, renderer.domElement);
      this.controls.enableDamping = false;
      this.controls.minDistance = 4;
      this.controls.maxDistance = 16 * this.reach + 1000;
      this.controls.addEventListener("change", () => this.ask());
      this.controls.addEventListener("start", () => { this.own = true; });
      this.hands();
      this.views();
      this.theme(options.theme || "dark");
      this.watcher = new ResizeObserver(() => this.fit());
      this.watcher.observe(element);
      this.fit();
      this.look("rig", false);
    }

    build() {
      const {scene, rig, look_: look, floor, reach} = this;
      const wide = reach + 45;
      const plate = rod(wide, floor - 12, floor, look.plate, 96);
      scene.add(this.part("plate", plate), this.holes(wide));
      this.head = head(rig, look);
      this.head.matrixAutoUpdate = false;
      scene.add(this.part("mirror", this.head));
      const table = this.head.foot - 6;
      scene.add(this.part("stage", rod(4.4 * rig.mirror.rim, table - 8, table, look.black)));
      scene.add(this.part("stage", rod(5.2 * rig.mirror.rim, floor, table - 8, look.body, 6)));
      rig.detectors.forEach((one, k) => this.place(one, detector(one, look.hues[k], look)));
      this.dimensions();
      this.laser();
      this.key = new THREE.DirectionalLight("#ffffff", 2);
      this.key.position.set(0.55 * reach, -0.9 * reach, 1.6 * reach);
      this.key.castShadow = true;
      this.key.shadow.mapSize.set(2048, 2048);
      Object.assign(this.key.shadow.camera, {
        left: -1.3 * reach, right: 1.3 * reach, bottom: -1.3 * reach, top: 1.3 * reach,
        near: 0.2 * reach, far: 4 * reach});
      this.key.shadow.radius = 5;
      this.key.shadow.bias = -0.0006;
      this.key.shadow.normalBias = 0.4;
      this.fill = new THREE.HemisphereLight("#ffffff", "#888888", 0.5);
      scene.add(this.key, this.fill);
      this.lights();
    }

    // The plate's threaded holes, every 25 mm.
    holes(wide) {
      const dot = new THREE.CircleGeometry(2.2, 20), points = [], index = [];
      const shape = dot.attributes.position.array, corners = dot.index.array;
      for (let x = -Math.ceil(wide / 25); x <= wide / 25; x++) {
        for (let y = -Math.ceil(wide / 25); y <= wide / 25; y++) {
          if (Math.hypot(25 * x, 25 * y) > wide - 8) continue;
          const first = points.length / 3;
          for (let n = 0; n < shape.length; n += 3) {
            points.push(shape[n] + 25 * x, shape[n + 1] + 25 * y, this.floor + 0.15);
          }
          index.push(...Array.from(corners, (n) => n + first));
        }
      }
      const all = new THREE.BufferGeometry();
      all.setAttribute("position", new THREE.BufferAttribute(new Float32Array(points), 3));
      all.setIndex(index);
      all.computeVertexNormals();
      const made = mesh(all, this.look_.holes);
      made.castShadow = false;
      return made;
    }

    // A detector where it stands, on its post.
    place(one, body) {
      const matrix = new THREE.Matrix4().makeBasis(...one.axes.map(V));
      body.applyMatrix4(matrix.setPosition(V(one.centre)));
      const [x, y, z] = along(one.centre, 8.5, one.axes[0]);
      const top = z - one.half[1] - 2;
      const post = rod(6.35, this.floor, top, this.look_.metal);
      const foot = rod(13, this.floor, this.floor + 6, this.look_.black);
      for (const part of [post, foot]) part.position.set(x, y, 0);
      this.scene.add(this.part(one.letter, body), this.part("post", post), this.part("post", foot));
      const out = along(one.centre, 6, one.axes[0]);
      this.label(one.letter, [out[0], out[1], z + one.half[1] + 22], "detector");
    }

    // How far the detectors stand from the axis: one line where all are as far.
    dimensions() {
      const radii = this.rig.detectors.map(({centre}) => Math.hypot(centre[0], centre[1]));
      const alike = Math.max(...radii) - Math.min(...radii) < 1e-6 * this.reach;
      this.rig.detectors.forEach(({centre: [x, y]}, k) => {
        if (alike && k > 0) return;
        const line = box(radii[k], 1.2, 0.3, this.look_.line, [x / 2, y / 2, this.floor + 0.4]);
        line.rotation.z = Math.atan2(y, x);
        line.castShadow = false;
        this.scene.add(line);
        this.label(`${+radii[k].toPrecision(4)} mm`, [0.6 * x, 0.6 * y, this.floor], "part length");
      });
    }

    laser() {
      const look = this.look_, group = this.laserBody = new THREE.Group();
      group.add(rod(5.5, 0, 18, look.metal), rod(7.5, 3, 6, look.black), rod(13, 16, 78, look.body));
      group.add(rod(13.15, 26, 28, look.metal), rod(13.15, 66, 68, look.metal));
      group.add(rod(2, 78, 90, look.black));
      const up = V(this.rig.beam.direction).negate();
      group.quaternion.setFromUnitVectors(V([0, 0, 1]), up);
      // its pillar stands where no sub-beam passes
      const angle = this.pillar(), far = 62;
      const [x, y] = [far * Math.cos(angle), far * Math.sin(angle)];
      const post = rod(9, this.floor, LASER + 62, look.metal);
      const foot = rod(20, this.floor, this.floor + 8, look.black);
      for (const part of [post, foot]) part.position.set(x, y, 0);
      const arm = box(far, 14, 14, look.black, [x / 2, y / 2, LASER + 46]);
      arm.rotation.z = angle;
      const ring = rod(17, LASER + 39, LASER + 53, look.black);
      this.scene.add(this.part("laser", group), post, foot, arm, ring);
      for (const part of [post, foot, arm, ring]) this.part("pillar", part);
      this.label("laser", [0, 0, LASER + 104], "part");
      this.label("mirror", [0, 0, 0], "part mirror");
    }

    // Makes a body one that can be clicked.
    part(name, body) {
      body.userData.part = name;
      this.parts.push(body);
      return body;
    }

    // From where the rig is seen at first: a little beside the first detector.
    front() {
      const [x, y] = this.rig.detectors[0].centre;
      return Math.atan2(y, x) - 0.56;
    }

    // The direction in the plate's plane that is farthest from all detectors.
    pillar() {
      const angles = this.rig.detectors.map((one) => Math.atan2(one.centre[1], one.centre[0]));
      const gap = (angle) => Math.min(...angles.map((a) => Math.abs(Math.atan2(
        Math.sin(a - angle), Math.cos(a - angle)))));
      // among equals the one at the back, as the rig is first seen
      const all = Array.from({length: 72}, (_, n) => n * Math.PI / 36);
      const worth = (angle) => gap(angle) - 0.2 * Math.cos(angle - this.front());
      return all.reduce((best, angle) => worth(angle) > worth(best) + 1e-9 ? angle : best);
    }

    lights() {
      this.beam = ribbon();
      this.subBeams = [0, 1, 2].map(ribbon);
      this.bodies = [0, 1, 2].map(() => glow(false));
      this.prints = [0, 1, 2].map(() => glow(true));
      this.spots = [0, 1, 2].map(() => glow(true));
      this.flares = [0, 1, 2].map(() => flare());
      this.scene.add(this.beam, ...this.subBeams, ...this.bodies, ...this.prints, ...this.spots,
        ...this.flares);
    }

    label(text, place, kind) {
      const element = document.createElement("div");
      element.className = `label ${kind}`;
      element.textContent = text;
      this.element.append(element);
      this.labels.push({element, place, kind});
    }

    views() {
      const row = this.looks = document.createElement("div");
      row.className = "looks";
      row.setAttribute("role", "group");
      row.setAttribute("aria-label", "Views");
      for (const name of ["rig", "mirror", "A", "B", "C"]) {
        const button = document.createElement("button");
        Object.assign(button, {type: "button", textContent: name[0].toUpperCase() + name.slice(1)});
        button.dataset.look = name;
        button.title = `Look at ${name.length > 1 ? `the ${name}` : `detector ${name}`}`;
        button.addEventListener("click", () => this.look(name));
        row.append(button);
      }
      this.element.append(row);
    }

    // What a pointer does: on the mirror it drags the mirror, elsewhere it turns the camera; a press
    // that stays in its place picks a part, however long it takes.
    hands() {
      const {element} = this, canvas = this.renderer.domElement;
      const place = ({clientX, clientY}) => {
        const box = canvas.getBoundingClientRect();
        return [clientX - box.left, clientY - box.top];
      };
      this.listen("pointerdown", (event) => {
        if (!event.isPrimary || event.button || event.target !== canvas) return;
        const at = place(event);
        this.camera.updateMatrixWorld();  // which is as it was drawn last
        this.press = {at, first: at, id: event.pointerId, moved: false, held: this.grabs(at)};
        if (!this.press.held) return;
        event.stopPropagation();
        element.setPointerCapture(event.pointerId);
      });
      this.listen("pointermove", (event) => {
        if (!this.press) canvas.classList.toggle("grabs", event.target === canvas && this.grabs(place(event)));
        if (!this.press || event.pointerId !== this.press.id) return;
        const at = place(event), {at: last, first, held} = this.press;
        this.press.at = at;
        if (Math.hypot(at[0] - first[0], at[1] - first[1]) >= 5) this.press.moved = true;
        if (held) this.drag(at[0] - last[0], last[1] - at[1], (this.mode === "turn") !== event.shiftKey);
      });
      this.listen("pointerup", (event) => {
        const {press} = this;
        this.press = null;
        if (press && event.pointerId === press.id && !press.moved) this.pick(place(event));
      });
      this.listen("pointercancel", () => { this.press = null; });
    }

    listen(name, act) {
      this.element.addEventListener(name, act, {capture: true, signal: this.ended.signal});
    }

    // Whether a drag from a place of the picture would take the mirror: as large as a fingertip at least.
    grabs([x, y]) {
      if (this.mode === "view" || !this.drawn) return false;
      const {clientWidth: wide, clientHeight: high} = this.element, {rim} = this.rig.mirror;
      const middle = V(this.drawn.apex).add(new THREE.Vector3(0, 0, -0.6 * rim));
      const pixels = high / 2 / Math.tan(this.camera.fov * Math.PI / 360)
        * rim / this.camera.position.distanceTo(middle);
      const seen = middle.project(this.camera);
      const off = Math.hypot((seen.x + 1) / 2 * wide - x, (1 - seen.y) / 2 * high - y);
      return seen.z < 1 && off < Math.max(pixels, 24);
    }

    // A drag by pixels to the right and up, in the plane of the picture. A turn is about the axis
    // across the drag, so that what faces the viewer goes the way of the pointer.
    drag(x, y, turning) {
      const half = this.element.clientHeight / 2, [a, b] = [x / half, y / half];
      const right = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 0);
      const up = new THREE.Vector3().setFromMatrixColumn(this.camera.matrixWorld, 1);
      const vector = turning ? up.multiplyScalar(a).addScaledVector(right, -b)
        : right.multiplyScalar(a).addScaledVector(up, b);
      this.options.onDrag(vector.toArray(), turning);
    }

    pick([x, y]) {
      const {clientWidth: wide, clientHeight: high} = this.element, ray = new THREE.Raycaster();
      ray.setFromCamera(new THREE.Vector2(2 * x / wide - 1, 1 - 2 * y / high), this.camera);
      let [body] = ray.intersectObjects(this.parts, true).map(({object}) => object);
      while (body && !body.userData.part) body = body.parent;
      if (body && this.options.onPick) this.options.onPick(body.userData.part);
    }

    orbit(left, up, closer = 1) {
      const {position} = this.camera, {target, minDistance, maxDistance} = this.controls;
      const [x, y, z] = position.clone().sub(target).toArray(), far = Math.hypot(x, y, z);
      const azimuth = Math.atan2(y, x) - left, most = Math.PI / 2 - 0.01;
      const height = Math.min(Math.max(Math.asin(z / far) + up, -most), most);
      const distance = Math.min(Math.max(far / closer, minDistance), maxDistance);
      position.set(Math.cos(height) * Math.cos(azimuth), Math.cos(height) * Math.sin(azimuth),
        Math.sin(height)).multiplyScalar(distance).add(target);
      this.own = true;
      this.controls.update();
      this.ask();
    }

    // The picture with its labels, on a pen whose pixels are so many times as wide.
    copy(pen, wide) {
      const {clientWidth, clientHeight} = this.element, scale = wide / clientWidth;
      this.draw();
      pen.drawImage(this.renderer.domElement, 0, 0, wide, clientHeight * scale);
      pen.textAlign = "center";
      pen.textBaseline = "middle";
      for (const {element} of this.labels) {
        const box = element.getBoundingClientRect(), base = this.element.getBoundingClientRect();
        if (!box.width) continue;
        const style = getComputedStyle(element);
        pen.font = `${style.fontWeight} ${parseFloat(style.fontSize) * scale}px ${style.fontFamily}`;
        pen.fillStyle = style.color;
        pen.fillText(element.textContent, (box.left + box.width / 2 - base.left) * scale,
          (box.top + box.height / 2 - base.top) * scale);
      }
    }

    // drawing: of light.js.  readings: nine, mm and mW, or null; NaN where a value is lost.
    update(drawing, readings) {
      this.drawn = drawing;
      const {rig} = this, [a, b, c] = drawing.turn, t = drawing.apex;
      this.head.matrix.set(...a, t[0], ...b, t[1], ...c, t[2], 0, 0, 0, 1);
      this.head.matrixWorldNeedsUpdate = true;
      const d = rig.beam.direction, up = [-d[0], -d[1], -d[2]];
      const from = along(drawing.place, LASER / up[2], up);
      this.laserBody.position.set(...from);
      const wide = Math.max(...rig.beam.diameter) / 2;
      const down = along(drawing.place, (t[2] - 1.5 * wide) / d[2], d);
      set(this.beam, from, down, wide, 0.9);
      const third = rig.beam.power / 3;
      drawing.facets.forEach((facet, k) => {
        const power = readings ? readings[3 * k + 2] : third;
        const share = Math.min(Math.sqrt(Math.max(power || 0, 0) / third), 1.6);
        const shown = facet.meets && facet.lit && share > 0;
        sheets(this.bodies[k], facet);
        lit(this.prints[k], facet, facet.onFacet);
        lit(this.spots[k], facet, facet.onDetector);
        this.subBeams[k].visible = this.flares[k].visible = shown;
        if (!shown) return;
        const middle = Math.floor(facet.grid.length / 2), half = facet.grid[middle].length >> 1;
        const start = facet.onFacet[middle][half];
        let end = facet.onDetector[middle][half];
        const one = rig.detectors[k], [psi, zeta] = readings ? readings.slice(3 * k, 3 * k + 2) : [];
        if (Number.isFinite(psi + zeta)) {
          end = along(along(one.centre, psi, one.axes[1]), zeta, one.axes[2]);
        }
        set(this.subBeams[k], start, end, 0.4 * wide, 0.25 + 0.55 * share);
        this.flares[k].position.set(...along(end, -0.4, one.axes[0]));
        this.flares[k].share = share;
      });
      const mirror = this.labels.find((each) => each.kind.includes("mirror"));
      mirror.place = [t[0], t[1], t[2]];
      this.ask();
    }

    theme(name) {
      if (name === this.shown) return;
      const colours = THEMES[name], look = this.look_;
      this.shown = name;
      for (const key of ["plate", "holes", "metal", "black", "body", "board", "silicon", "line"]) {
        look[key].color.set(colours[key]);
      }
      const hues = this.rig.hues[name], blending = name === "dark"
        ? THREE.AdditiveBlending : THREE.NormalBlending;
      hues.forEach((hue, k) => {
        look.hues[k].color.set(hue);
        look.facets[k].color.set("#e9eef4").lerp(new THREE.Color(hue), 0.16);
        tint(this.subBeams[k], hue, THREE.NormalBlending, name === "dark" ? 0.45 : 0);
        for (const body of [this.bodies[k], this.prints[k], this.spots[k]]) {
          tint(body, hue, blending, name === "dark" ? 0.35 : 0);
        }
        this.flares[k].material.color.set(hue);
        this.flares[k].material.blending = blending;
      });
      tint(this.beam, colours.beam, blending, name === "dark" ? 0.5 : 0);
      if (this.scene.environment) this.scene.environment.dispose();
      this.scene.environment = surroundings(this.renderer, colours);
      this.scene.background = new THREE.Color(colours.fog);
      this.scene.environmentIntensity = name === "dark" ? 1.5 : 0.9;
      this.key.intensity = colours.key;
      this.fill.intensity = colours.fill;
      this.labels.forEach(({element}, n) => {
        if (n < 3) element.style.setProperty("--hue", hues[n]);
      });
      this.renderer.shadowMap.needsUpdate = true;
      this.ask();
    }

    // Flies to a view; at once where the reader prefers less motion.
    look(name, flying = true) {
      const {rig} = this, apex = this.drawn ? this.drawn.apex : [0, 0, 0];
      const narrow = Math.max(1, 0.9 / this.camera.aspect);
      let target, from;
      if (name === "mirror") {
        target = [apex[0], apex[1], apex[2] - 0.62 * rig.mirror.rim];
        from = along(target, narrow * rig.mirror.rim, [2.9, -4.1, 3.1]);
      } else if (name === "rig") {
        ({target, from} = this.whole());
      } else {
        const one = rig.detectors["ABC".indexOf(name)], size = 2 * narrow * Math.max(...one.half);
        target = one.centre;
        from = along(along(along(one.centre, -5.2 * size, one.axes[0]), 1.3 * size, one.axes[1]),
          1.5 * size, one.axes[2]);
      }
      Object.assign(this, {view: name, own: false});
      for (const button of this.looks.children) {
        button.setAttribute("aria-pressed", button.dataset.look === name);
      }
      const still = matchMedia("(prefers-reduced-motion: reduce)").matches;
      const begin = [this.camera.position.clone(), this.controls.target.clone()];
      const goal = [V(from), V(target)], time = performance.now();
      cancelAnimationFrame(this.flight);
      const step = (now) => {
        const s = flying && !still ? Math.min((now - time) / 700, 1) : 1, e = s * s * (3 - 2 * s);
        // the distance changes evenly in proportion, so that a long way in is as smooth as out
        const offset = (n) => n[0].clone().sub(n[1]);
        const far = offset(begin).length() ** (1 - e) * offset(goal).length() ** e;
        this.controls.target.lerpVectors(begin[1], goal[1], e);
        this.camera.position.copy(offset(begin).normalize().lerp(offset(goal).normalize(), e))
          .normalize().multiplyScalar(far).add(this.controls.target);
        this.controls.update();
        this.ask();
        if (s < 1) this.flight = requestAnimationFrame(step);
      };
      step(time);
    }

    // From where all detectors with their posts and labels, and the laser, are in the picture, clear
    // of the buttons above and of what options.below() says lies over its lower edge (pixels). The
    // camera looks at the mirror's axis.
    whole() {
      const {element: {clientWidth: wide, clientHeight: high}, camera, rig, floor} = this;
      const half = Math.tan(camera.fov * Math.PI / 360), below = this.options.below ? this.options.below() : 0;
      const room = (pixels, size) => Math.max(1 - 2 * pixels / size, 0.3);
      const side = half * camera.aspect * room(18, wide);
      const top = half * room(this.looks.offsetTop + this.looks.offsetHeight + 10, high);
      const low = half * room(below + 12, high);
      // the detector opposite and the laser's pillar stand to both sides of the beam
      const azimuth = this.front(), rise = Math.atan(1.85 / 2.7);
      const [c, s] = [Math.cos(rise), Math.sin(rise)], [x, y] = [Math.cos(azimuth), Math.sin(azimuth)];
      const points = [[0, 0, LASER + 104], ...rig.detectors.flatMap(({centre, axes, half: [y_, z_]}) =>
        [-1, 1].flatMap((sign) => [floor, centre[2] + z_ + 26].map((z) =>
          [...along(along(centre, sign * (y_ + 10), axes[1]), 6, axes[0]).slice(0, 2), z])))];
      // of each point: towards the camera, sideways, and up in the picture
      const seen = points.map(([a, b, z]) =>
        [c * (a * x + b * y) + s * z, Math.abs(b * x - a * y), c * z - s * (a * x + b * y)]);
      const most = (value) => Math.max(...seen.map(value));
      const upper = most(([d, , u]) => d + u / top), lower = most(([d, , u]) => d - u / low);
      const balance = (upper - lower) / (1 / top + 1 / low);
      const far = Math.max(most(([d, r]) => d + r / side), upper - balance / top);
      const up = (top * (upper - far) + low * (far - lower)) / 2;
      const target = [0, 0, up / c];
      return {target, from: along(target, far - up * s / c, [c * x, c * y, s])};
    }

    fit() {
      const {clientWidth: wide, clientHeight: high} = this.element;
      if (!wide || !high) return;
      this.renderer.setSize(wide, high);
      this.camera.aspect = wide / high;
      this.camera.updateProjectionMatrix();
      if (this.view === "rig" && !this.own) this.look("rig", false);
      if (this.drawn) this.draw();  // at once: another size has emptied the picture
      else this.ask();
    }

    // Draws once, soon; only when something has changed.
    ask() {
      if (!this.asked) this.asked = requestAnimationFrame(() => this.draw());
    }

    draw() {
      this.asked = 0;
      const {clientWidth: wide, clientHeight: high} = this.element;
      const distance = this.camera.position.distanceTo(this.controls.target);
      this.camera.near = Math.max(distance / 60, 0.3);
      this.camera.far = 2 * distance + 8 * this.reach + 1000;
      this.camera.updateProjectionMatrix();
      const scale = high / 2 / Math.tan(this.camera.fov * Math.PI / 360);
      for (const one of [this.beam, ...this.subBeams]) {
        one.material.uniforms.size.value.set(wide, high);
        one.material.uniforms.scale.value = scale;
      }
      // bodies of light near by, strips of some pixels from afar
      const pixels = scale * Math.max(...this.rig.beam.diameter) / distance;
      const near = Math.min(Math.max((pixels - 5) / 8, 0), 1);
      this.bodies.forEach((body, k) => {
        body.material.uniforms.strength.value = 0.16 * near;
        this.subBeams[k].material.uniforms.strength.value = this.subBeams[k].strength * (1 - 0.75 * near);
      });
      for (const each of [...this.prints, ...this.spots]) each.material.uniforms.strength.value = 0.95;
      this.flares.forEach((each) => {
        const size = 2 * Math.max(9, Math.min(pixels, 14)) / scale;
        each.scale.setScalar(size * this.camera.position.distanceTo(each.position));
        each.material.opacity = (1 - near) * Math.min(0.35 + 0.5 * (each.share || 0), 1);
      });
      this.renderer.render(this.scene, this.camera);
      this.put(wide, high, distance);
    }

    // The labels, each where its place is seen.
    put(wide, high, distance) {
      for (const {element, place, kind} of this.labels) {
        const seen = V(place).project(this.camera);
        const inside = seen.z < 1 && Math.abs(seen.x) < 0.98 && Math.abs(seen.y) < 0.98;
        const hidden = kind.includes("part") && distance < this.reach;
        element.style.display = inside && !hidden ? "" : "none";
        const x = (seen.x + 1) / 2 * wide, y = (1 - seen.y) / 2 * high;
        element.style.transform = `translate(-50%, -50%) translate(${x}px, ${y}px)`;
      }
    }

    dispose() {
      cancelAnimationFrame(this.asked);
      cancelAnimationFrame(this.flight);
      this.ended.abort();
      this.watcher.disconnect();
      this.controls.dispose();
      this.looks.remove();
      this.renderer.dispose();
      this.renderer.forceContextLoss();  // a browser has room for some sixteen
      this.renderer.domElement.remove();
      this.labels.forEach(({element}) => element.remove());
    }
  }

  function along(p, s, d) {
    return [p[0] + s * d[0], p[1] + s * d[1], p[2] + s * d[2]];
  }

  function set(body, start, end, radius, strength) {
    const {uniforms} = body.material;
    uniforms.start.value.set(...start);
    uniforms.end.value.set(...end);
    uniforms.radius.value = radius;
    uniforms.strength.value = body.strength = strength;
  }

  function tint(body, colour, blending, hot) {
    body.material.uniforms.colour.value.set(colour);
    body.material.uniforms.hot.value = hot;
    body.material.blending = blending;
  }

  // The shine of a spot from afar.
  function flare() {
    const canvas = document.createElement("canvas");
    canvas.width = canvas.height = 64;
    const pen = canvas.getContext("2d"), shade = pen.createRadialGradient(32, 32, 0, 32, 32, 32);
    [[0, 1], [0.2, 0.75], [0.45, 0.22], [1, 0]].forEach(([at, alpha]) =>
      shade.addColorStop(at, `rgba(255,255,255,${alpha})`));
    pen.fillStyle = shade;
    pen.fillRect(0, 0, 64, 64);
    return new THREE.Sprite(new THREE.SpriteMaterial({
      map: new THREE.CanvasTexture(canvas), transparent: true, depthWrite: false}));
  }

  return {create};
})();
