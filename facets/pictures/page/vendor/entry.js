// What scene.js draws with.
export {
  ACESFilmicToneMapping, AdditiveBlending, BoxGeometry, BufferAttribute, BufferGeometry,
  CanvasTexture, CircleGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, Euler,
  ExtrudeGeometry, Group, HemisphereLight, Matrix4, Mesh, MeshBasicMaterial,
  MeshStandardMaterial, NormalBlending, PCFShadowMap, PMREMGenerator, PerspectiveCamera,
  PlaneGeometry, Raycaster, Scene, ShaderMaterial, Shape, Sprite, SpriteMaterial, Vector2, Vector3,
  WebGLRenderer,
} from "three";
export {OrbitControls} from "three/addons/controls/OrbitControls.js";
