// 3D figure: worker in blue, suggested pose in black, and a ball on each joint whose colour, size and sign show the level.
import {
  AmbientLight, CanvasTexture, CircleGeometry, Color, CylinderGeometry, DirectionalLight, DoubleSide, DynamicDrawUsage,
  GridHelper, InstancedMesh, LineBasicMaterial, LineLoop, BufferGeometry, Matrix4, Mesh, MeshBasicMaterial,
  MeshLambertMaterial, PerspectiveCamera, Quaternion, Scene, SphereGeometry, Sprite, SpriteMaterial, SRGBColorSpace,
  Vector3, WebGLRenderer,
} from "three";
import { FEET, JOINT, LEVELS, bones, colour, headCentre, levelOf } from "./body.js";
import { isPlaced } from "./match.js";
import { Orbit } from "./orbit.js";
import { ViewCentre } from "./view_centre.js";

const DISTANCE_M = 5.5;
// Includes raised hands, enlarged by perspective, and a margin below the floor.
const SHOWN_HEIGHT_M = 2.65;
const SHOWN_WIDTH_M = 2.0;
// The suggested pose is thinner, so that the worker's limbs cover it once they match.
const GHOST_THICKNESS = 0.72;
const BONES = 26;
const BALLS = 2 * BONES;

const Y = new Vector3(0, 1, 0);
const matrix = new Matrix4();
const turn = new Quaternion();
const [from, to, middle, along, size] = Array.from({ length: 5 }, () => new Vector3());

// Body of capsules: a cylinder and two balls per bone, and a head.
class Body {
  constructor(scene, { material, order, thickness = 1 }) {
    const instanced = (geometry, count) => {
      const mesh = new InstancedMesh(geometry, material, count);
      mesh.instanceMatrix.setUsage(DynamicDrawUsage);
      mesh.frustumCulled = false;
      mesh.renderOrder = order;
      scene.add(mesh);
      return mesh;
    };
    this.thickness = thickness;
    this.cylinders = instanced(new CylinderGeometry(1, 1, 1, 14, 1, true), BONES);
    this.balls = instanced(new SphereGeometry(1, 14, 10), BALLS + 1);
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
    for (const mesh of this.meshes) mesh.visible = true;
    bones(origins).forEach((bone, i) => {
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
    matrix.compose(from.fromArray(headCentre(origins)), turn.identity(), size.set(0.095, 0.085, 0.115).multiplyScalar(this.thickness));
    this.balls.setMatrixAt(BALLS, matrix);
    if (colourOf) this.balls.setColorAt(BALLS, colourOf(6));
    for (const mesh of [this.cylinders, this.balls]) {
      mesh.instanceMatrix.needsUpdate = true;
      if (mesh.instanceColor) mesh.instanceColor.needsUpdate = true;
    }
    // three.js allocates `instanceColor` at the first `setColorAt`, after the copies were made.
    this.meshes.forEach((mesh, i) => { mesh.instanceColor = this.meshes[i % 2].instanceColor; });
  }
}

// Material of a ball with its level's sign.
function ball(level) {
  const canvas = Object.assign(document.createElement("canvas"), { width: 96, height: 96 });
  const context = canvas.getContext("2d");
  // Small highlight only, so that the colour matches the legend.
  const light = context.createRadialGradient(34, 30, 1, 36, 32, 20);
  light.addColorStop(0, "#ffffff90");
  light.addColorStop(1, "#ffffff00");
  context.beginPath();
  context.arc(48, 48, 42, 0, 2 * Math.PI);
  for (const fill of [colour(level), light]) {
    context.fillStyle = fill;
    context.fill();
  }
  context.lineWidth = 7;
  context.strokeStyle = "#ffffff";
  context.stroke();
  context.fillStyle = "#ffffff";
  context.font = "700 56px system-ui, 'DejaVu Sans', sans-serif";
  context.textAlign = "center";
  context.textBaseline = "middle";
  context.fillText(LEVELS[level].sign, 48, 51);
  const map = new CanvasTexture(canvas);
  map.colorSpace = SRGBColorSpace;
  return new SpriteMaterial({ map, depthTest: false, transparent: true });
}

export class Figure3d extends Orbit {
  constructor(canvas) {
    super(canvas);
    this.canvas = canvas;
    // Throws where the browser has no WebGL.
    this.renderer = new WebGLRenderer({ canvas, antialias: true, alpha: true });
    this.viewCentre = new ViewCentre();
    this.scene = new Scene();
    this.camera = new PerspectiveCamera();
    this.camera.up.set(0, 0, 1);
    this.lights();
    this.floor();
    this.worker = new Body(this.scene, { material: new MeshLambertMaterial({ color: colour("you") }), order: 0 });
    // Depth pass first, then one blended pass: otherwise overlapping limbs would be darker.
    this.ghost = new Body(this.scene, { material: new MeshBasicMaterial({ colorWrite: false }), order: 1, thickness: GHOST_THICKNESS });
    this.ghost.addPass(this.scene, new MeshLambertMaterial({ transparent: true, opacity: 0.7 }), 2);
    this.shades = { black: new Color("#0b0e12"), placed: new Color(colour("green")) };
    this.materials = Object.fromEntries(Object.keys(LEVELS).map((level) => [level, ball(level)]));
    this.joints = JOINT.map(() => {
      const sprite = new Sprite(this.materials.none);
      sprite.renderOrder = 3;
      this.scene.add(sprite);
      return sprite;
    });
  }

  lights() {
    this.scene.add(new AmbientLight("#ffffff", 1.7));
    this.lamp = new DirectionalLight("#ffffff", 2.0);
    this.scene.add(this.lamp, this.lamp.target);
  }

  floor() {
    this.ground = new Mesh(new CircleGeometry(1.35, 64), new MeshBasicMaterial({ color: colour("floor"), side: DoubleSide }));
    this.ground.renderOrder = -2;
    this.grid = new GridHelper(2, 8, colour("grid"), colour("grid"));
    this.grid.rotation.x = Math.PI / 2;
    this.shadows = FEET.map(() => new Mesh(new CircleGeometry(0.16, 32), new MeshBasicMaterial({ color: "#000000", transparent: true, opacity: 0.12, depthWrite: false })));
    this.plate = new LineLoop(new BufferGeometry(), new LineBasicMaterial({ color: colour("none") }));
    this.scene.add(this.ground, this.grid, this.plate, ...this.shadows);
  }

  // `frame` is null while no data are available. `deviations`: angle of each limb from the suggested pose, rad.
  draw(frame, deviations, reachedRad) {
    const origins = frame?.segment_origin_m;
    const [x, y, z] = this.viewCentre.update(origins);
    this.ground.position.set(x, y, z - 0.004);
    this.grid.position.set(Math.round(x * 4) / 4, Math.round(y * 4) / 4, z - 0.002);
    this.plate.visible = Boolean(frame?.plate_corners_m);
    if (this.plate.visible) this.plate.geometry.setFromPoints(frame.plate_corners_m.map(([a, b]) => new Vector3(a, b, z)));
    if (origins) this.worker.show(origins);
    else this.worker.hide();
    if (frame?.suggested) this.ghost.show(frame.suggested.segment_origin_m, (segment) => this.shadeOf(segment, deviations, reachedRad));
    else this.ghost.hide();
    this.shadows.forEach((shadow, i) => {
      shadow.visible = Boolean(origins);
      if (!origins) return;
      const [heel, toe] = FEET[i].map((segment) => origins[segment]);
      shadow.position.set((heel[0] + toe[0]) / 2, (heel[1] + toe[1]) / 2, z);
    });
    this.drawJoints(frame, origins);
    this.aimCamera([x, y, z + 1.06]);
    this.renderer.render(this.scene, this.camera);
    // For tests of the page.
    this.canvas.dataset.drawn = [origins && "worker", frame?.suggested && "suggested"].filter(Boolean).join(" ");
    this.canvas.dataset.triangles = String(this.renderer.info.render.triangles);
  }

  shadeOf(segment, deviations, reachedRad) {
    return isPlaced(segment, deviations, reachedRad) ? this.shades.placed : this.shades.black;
  }

  drawJoints(frame, origins) {
    // Levels are available only after identification.
    const evaluated = origins && frame.state.phase === "monitoring";
    this.joints.forEach((sprite, i) => {
      sprite.visible = Boolean(evaluated);
      if (!evaluated) return;
      const level = levelOf(frame, JOINT[i]);
      sprite.material = this.materials[level] ?? this.materials.none;
      sprite.scale.setScalar(2 * (LEVELS[level] ?? LEVELS.none).radius);
      sprite.position.fromArray(origins[i + 1]);
    });
  }

  aimCamera(target) {
    const { width, height } = this.canvas.getBoundingClientRect();
    const ratio = Math.min(window.devicePixelRatio || 1, 2);
    if (this.width !== width || this.height !== height || this.ratio !== ratio) {
      [this.width, this.height, this.ratio] = [width, height, ratio];
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height, false);
      this.camera.aspect = width / Math.max(height, 1);
      const shown = Math.max(SHOWN_HEIGHT_M, SHOWN_WIDTH_M / this.camera.aspect);
      this.camera.fov = 2 * Math.atan(shown / 2 / DISTANCE_M) * 180 / Math.PI;
      this.camera.updateProjectionMatrix();
    }
    const { towards, right } = this.axes();
    this.camera.position.set(...target.map((v, i) => v + DISTANCE_M * towards[i]));
    this.camera.lookAt(...target);
    this.lamp.position.set(...target.map((v, i) => v + 2 * towards[i] - 2 * right[i] + (i === 2 ? 2.5 : 0)));
    this.lamp.target.position.set(...target);
  }

  // Canvas position of a world point, CSS pixels.
  project(point) {
    const clip = from.fromArray(point).project(this.camera);
    return [(clip.x + 1) * this.width / 2, (1 - clip.y) * this.height / 2];
  }
}
