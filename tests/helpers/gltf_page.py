"""Page that draws a glTF file's triangles offline with WebGL alone."""

import json

PAGE = """<!doctype html><body style="margin:0"><canvas width=900 height=700></canvas>
<script>
const scene = SCENE;
const gl = document.querySelector("canvas").getContext("webgl", {preserveDrawingBuffer: true});
gl.getExtension("OES_element_index_uint");
const bytes = scene.buffers.map(b =>
  Uint8Array.from(atob(b.uri.split(",")[1]), c => c.charCodeAt(0)).buffer);
function read(number) {
  const a = scene.accessors[number], v = scene.bufferViews[a.bufferView];
  const kind = {5126: Float32Array, 5125: Uint32Array, 5123: Uint16Array}[a.componentType];
  const size = {SCALAR: 1, VEC3: 3}[a.type] * a.count;
  return new kind(bytes[v.buffer], (v.byteOffset || 0) + (a.byteOffset || 0), size);
}
const parts = [];
for (const mesh of scene.meshes) for (const p of mesh.primitives)
  if ((p.mode ?? 4) === 4 && p.indices !== undefined)
    parts.push({places: read(p.attributes.POSITION), faces: read(p.indices),
      colour: scene.materials[p.material].pbrMetallicRoughness.baseColorFactor});
const low = [1e9, 1e9, 1e9], high = [-1e9, -1e9, -1e9];
for (const p of parts) p.places.forEach((x, i) => {
  low[i % 3] = Math.min(low[i % 3], x); high[i % 3] = Math.max(high[i % 3], x); });
const middle = low.map((x, i) => (x + high[i]) / 2);
const size = Math.max(...high.map((x, i) => x - low[i])) / 1.6;
function shader(kind, text) {
  const s = gl.createShader(kind); gl.shaderSource(s, text); gl.compileShader(s); return s;
}
const program = gl.createProgram();
gl.attachShader(program, shader(gl.VERTEX_SHADER, `
  attribute vec3 p; uniform vec3 m; uniform float s;
  void main() {
    vec3 q = (p - m) / s;
    float across = 0.8 * q.x + 0.6 * q.y, up = q.z + 0.3 * q.y - 0.2 * q.x;
    gl_Position = vec4(across, up, 0.1 * (q.y - q.x), 1.0);
  }`));
gl.attachShader(program, shader(gl.FRAGMENT_SHADER,
  "precision mediump float; uniform vec4 c; void main() { gl_FragColor = c; }"));
gl.linkProgram(program); gl.useProgram(program);
gl.clearColor(1, 1, 1, 1); gl.clear(gl.COLOR_BUFFER_BIT);
gl.enable(gl.BLEND); gl.blendFunc(gl.SRC_ALPHA, gl.ONE_MINUS_SRC_ALPHA);
gl.uniform3fv(gl.getUniformLocation(program, "m"), middle);
gl.uniform1f(gl.getUniformLocation(program, "s"), size);
const where = gl.getAttribLocation(program, "p");
gl.enableVertexAttribArray(where);
for (const p of parts) {
  gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ARRAY_BUFFER, p.places, gl.STATIC_DRAW);
  gl.vertexAttribPointer(where, 3, gl.FLOAT, false, 0, 0);
  gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer());
  gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, p.faces, gl.STATIC_DRAW);
  gl.uniform4fv(gl.getUniformLocation(program, "c"), p.colour);
  const kind = p.faces instanceof Uint32Array ? gl.UNSIGNED_INT : gl.UNSIGNED_SHORT;
  gl.drawElements(gl.TRIANGLES, p.faces.length, kind, 0);
}
</script>"""


def page_of(scene):
    return PAGE.replace("SCENE", json.dumps(scene), 1)
