// 3D figure: the worker, and the suggested pose as a translucent body.
import {
  AmbientLight, BufferGeometry, CircleGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage, Float32BufferAttribute,
  InstancedMesh, LineBasicMaterial, LineLoop, LineSegments, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  PerspectiveCamera, Quaternion, Scene, ShapeGeometry, Shape, SphereGeometry, Vector2, Vector3, WebGLRenderer,
} from "three";
import { FEET, bones, cobotBones, headCentre, cornersOf } from "./body.js";
import { isPlaced } from "./match.js";
import { colour } from "./theme.js";

// The suggested pose is thinner, so that the worker's limbs cover it once they match.
const GHOST_THICKNESS = 0.72;
const BONES = 26;
const COBOT_BONES = 8;

const Y = new Vector3(0, 1, 0);
const matrix = new Matrix4();
const turn = new Quaternion();
const [from, to, middle, along, size] = Array.from({ length: 5 }, () => new Vector3());

// Body of capsules: a cylinder and two balls per bone, and a head unless it has none.
class Body {
  constructor(scene, { material, order, thickness = 1, count = BONES, heads = 1 }) {
    const instanced = (geometry, instances) => {
      const mesh = new InstancedMesh(geometry, material, instances);
      mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      mesh.frustumCulled = false;
      mesh.renderOrder = order;
      scene.add(mesh);
      return mesh;
    };
    this.thickness = thickness;
    this.cylinders = instanced(new CylinderGeometry(1, 1, 1, 14, 1, true), count);
    this.balls = instanced(new SphereGeometry(1, 14, 10), 2 * count + heads);
    this.meshes = [this.cylinders, this.balls];
  }

  // Adds another render pass of the same body with another material.
  addPass(scene, material, order) {
    for (const mesh of [...this.meshes]) {
      const copy = new InstancedMesh(mesh.geometry, material, mesh.count);
      copy.instanceMatrix = mesh.instanceMatrix;
      copy.frustumCulled = false;
      copy.renderOrder = order;
      scene.add(copy);
      this.meshes.push(copy);
    }
  }

  hide() { for (const mesh of this.meshes) mesh.visible = false; }

  show(origins, colourOf) {
    matrix.compose(from.fromArray(headCentre(origins)), turn.identity(), size.set(0.095, 0.085, 0.115).multiplyScalar(this.thickness));
    this.balls.setMatrixAt(2 * BONES, matrix);
    if (colourOf) this.balls.setColorAt(2 * BONES, colourOf(6));
    this.place(bones(origins), colourOf);
  }

  place(all, colourOf) {
    for (const mesh of this.meshes) mesh.visible = true;
    all.forEach((bone, i) => {
      from.fromArray(bone.from);
      to.fromArray(bone.to);
      const radius = bone.radius * this.thickness;
      along.subVectors(to, from);
      const length = Math.max(along.length(), 1e-6);
      turn.setFromUnitVectors(Y, along.divideScalar(length));
      matrix.compose(middle.addVectors(from, to).multiplyScalar(0.5), turn, size.set(radius, length, radius));
      this.cylinders.setMatrixAt(i, matrix);
      [from, to].forEach((end, k) => {
        matrix.compose(end, turn.identity(), size.setScalar(radius));
        this.balls.setMatrixAt(2 * i + k, matrix);
      });
      if (colourOf) {
        const shade = colourOf(bone.segment);
        this.cylinders.setColorAt(i, shade);
        this.balls.setColorAt(2 * i, shade);
        this.balls.setColorAt(2 * i + 1, shade);
      }
    });
    for (const mesh of [this.cylinders, this.balls]) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
    // three.js allocates `instanceColor` at the first `setColorAt`, after the copies were made.
    this.meshes.forEach((mesh, i) => { mesh.instanceColor = this.meshes[i % 2].instanceColor; });
  }
}

export class Figure3d {
  constructor(canvas) {
    this.canvas = canvas;
    // Throws where the browser has no WebGL.
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.scene = new Scene();
    this.camera = new PerspectiveCamera();
    this.camera.up.set(0, 0, 1);
    this.lamp = new DirectionalLight("#ffffff", 2.0);
    this.scene.add(new AmbientLight("#ffffff", 1.7), this.lamp, this.lamp.target);
    this.floor();
    this.skin = new MeshLambertMaterial();
    this.worker = new Body(this.scene, { material: this.skin, order: 0 });
    this.cobot = new Body(this.scene, { material: new MeshLambertMaterial(), order: 0, count: COBOT_BONES, heads: 0 });
    // Depth pass first, then one blended pass: otherwise overlapping limbs would be darker.
    this.ghost = new Body(this.scene, { material: new MeshBasicMaterial({ colorWrite: false }), order: 1, thickness: GHOST_THICKNESS });
    this.ghost.addPass(this.scene, new MeshLambertMaterial({ transparent: true, opacity: 0.75 }), 2);
    this.recolour();
  }

  floor() {
    const material = (more) => new MeshBasicMaterial({ side: DoubleSide, ...more });
    this.ground = new Mesh(new CircleGeometry(1.35, 64), material());
    this.ground.renderOrder = -2;
    const lines = Array.from({ length: 9 }, (_, k) => (k - 4) / 4).flatMap((at) => [at, -1, 0, at, 1, 0, -1, at, 0, 1, at, 0]);
    this.grid = new LineSegments(new BufferGeometry().setAttribute("position", new Float32BufferAttribute(lines, 3)), new LineBasicMaterial());
    this.plate = new Mesh(new BufferGeometry(), material());
    this.edge = new LineLoop(new BufferGeometry(), new LineBasicMaterial());
    this.shadows = FEET.map(() => new Mesh(new CircleGeometry(0.16, 32), material({ color: "#000000", transparent: true, opacity: 0.18, depthWrite: false })));
    this.scene.add(this.ground, this.grid, this.plate, this.edge, ...this.shadows);
  }

  // Takes the colours of the theme.
  recolour() {
    this.shades = Object.fromEntries(["you", "ghost", "placed", "none", "load"].map((name) => [name, new Color(colour(name))]));
    for (const [name, mesh] of [["floor", this.ground], ["grid", this.grid], ["plate", this.plate], ["soft", this.edge]]) mesh.material.color.set(colour(name));
  }

  // `frame` is null while no data are available. `deviations`: angle of each limb from the suggested pose, rad.
  draw(view, frame, faded, deviations, reachedRad) {
    const origins = frame?.segment_origin_m;
    const [x, y, z] = view.centre;
    this.ground.position.set(x, y, z - 0.006);
    this.grid.position.set(Math.round(x * 4) / 4, Math.round(y * 4) / 4, z - 0.004);
    this.drawPlate(cornersOf(frame), z - 0.002);
    this.skin.color.copy(this.shades[faded ? "none" : "you"]);
    if (origins) this.worker.show(origins);
    else this.worker.hide();
    if (frame?.cobot) this.cobot.place(cobotBones(frame.cobot), (segment) => this.shades[segment === "part" ? "load" : "none"]);
    else this.cobot.hide();
    if (origins && frame.suggested) this.ghost.show(frame.suggested.segment_origin_m, (segment) => this.shades[isPlaced(segment, deviations, reachedRad) ? "placed" : "ghost"]);
    else this.ghost.hide();
    this.shadows.forEach((shadow, i) => {
      shadow.visible = Boolean(origins);
      if (!origins) return;
      const [heel, toe] = FEET[i].map((segment) => origins[segment]);
      shadow.position.set((heel[0] + toe[0]) / 2, (heel[1] + toe[1]) / 2, z);
    });
    this.aimCamera(view);
    this.renderer.render(this.scene, this.camera);
    // For tests of the page.
    this.canvas.dataset.triangles = String(this.renderer.info.render.triangles);
  }

  drawPlate(corners, z) {
    this.plate.visible = this.edge.visible = Boolean(corners);
    const key = JSON.stringify(corners);
    this.plate.position.z = this.edge.position.z = z;
    if (!corners || key === this.plateKey) return;
    this.plateKey = key;
    this.plate.geometry = new ShapeGeometry(new Shape(corners.map(([a, b]) => new Vector2(a, b))));
    this.edge.geometry.setFromPoints(corners.map(([a, b]) => new Vector3(a, b, 0.001)));
  }

  aimCamera(view) {
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (this.width !== view.width || this.height !== view.height || this.ratio !== ratio) {
      [this.width, this.height, this.ratio] = [view.width, view.height, ratio];
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(this.width, this.height, false);
    }
    this.camera.aspect = view.width / Math.max(view.height, 1);
    this.camera.fov = view.fov;
    this.camera.updateProjectionMatrix();
    const { eye, target, towards, right } = view;
    this.camera.position.set(...eye);
    this.camera.lookAt(...target);
    this.lamp.position.set(...target.map((v, i) => v + 2 * towards[i] - 2 * right[i] + (i === 2 ? 2.5 : 0)));
    this.lamp.target.position.set(...target);
    this.canvas.style.transform = view.mirrored ? "scaleX(-1)" : "";
  }
}
