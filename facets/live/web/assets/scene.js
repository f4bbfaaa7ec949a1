export class Scene {
  constructor(root) { this.root = root; }
  show() {}
}
