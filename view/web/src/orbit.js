// Orbit control of the view: by dragging and arrow keys; azimuth and elevation in degrees.
const STEPS = { ArrowLeft: [-6, 0], ArrowRight: [6, 0], ArrowUp: [0, 4], ArrowDown: [0, -4] };

export class Orbit {
  constructor(canvas) {
    this.azimuth = 30;
    this.elevation = 12;
    this.onturn = () => {};
    let dragged = null;
    canvas.addEventListener("pointerdown", (event) => {
      dragged = [event.clientX, event.clientY];
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => {
      if (!dragged) return;
      this.turn((dragged[0] - event.clientX) * 0.4, (event.clientY - dragged[1]) * 0.3);
      dragged = [event.clientX, event.clientY];
    });
    for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, () => { dragged = null; });
    canvas.addEventListener("keydown", (event) => {
      const step = STEPS[event.key];
      if (!step) return;
      event.preventDefault();
      this.turn(...step);
    });
  }

  turn(azimuth, elevation) {
    this.azimuth = (this.azimuth + azimuth + 360) % 360;
    this.elevation = Math.min(80, Math.max(-5, this.elevation + elevation));
    this.onturn();
  }

  // Unit vectors of the view: towards the camera, right, up.
  axes() {
    const [az, el] = [this.azimuth, this.elevation].map((degrees) => degrees * Math.PI / 180);
    return {
      towards: [Math.cos(az) * Math.cos(el), Math.sin(az) * Math.cos(el), Math.sin(el)],
      right: [-Math.sin(az), Math.cos(az), 0],
      up: [-Math.cos(az) * Math.sin(el), -Math.sin(az) * Math.sin(el), Math.cos(el)],
    };
  }
}
