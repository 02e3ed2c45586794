// Draws on a canvas in world coordinates, m.
export class Pen {
  constructor(context, project) {
    this.context = context;
    this.project = project;
  }

  path(points) {
    this.context.beginPath();
    for (const [x, y] of points.map(this.project)) this.context.lineTo(x, y);
  }

  // `thickness` in metres; at least `least` pixels.
  line(points, style, thickness, least = 2) {
    const { context } = this;
    this.path(points);
    context.strokeStyle = style;
    context.lineWidth = Math.max(least, thickness * this.project(points[0])[2]);
    context.lineCap = context.lineJoin = "round";
    context.stroke();
  }

  area(points, fill, edge, alpha = 1, width = 1.5) {
    const { context } = this;
    this.path(points);
    context.closePath();
    context.globalAlpha = alpha;
    context.fillStyle = fill;
    context.fill();
    context.globalAlpha = 1;
    if (!edge) return;
    context.strokeStyle = edge;
    context.lineWidth = width;
    context.lineJoin = "round";
    context.stroke();
  }

  disc(point, radius, fill, edge, width = 2) {
    const { context } = this;
    const [x, y, scale] = this.project(point);
    context.beginPath();
    context.arc(x, y, radius * scale, 0, 2 * Math.PI);
    context.fillStyle = fill;
    context.fill();
    if (!edge) return;
    context.strokeStyle = edge;
    context.lineWidth = width;
    context.stroke();
  }

  // A text of `size` pixels, with a margin that separates it from what is behind it.
  text(text, [x, y], size, ink, ground) {
    const { context } = this;
    context.font = `700 ${Math.round(size)}px system-ui, "DejaVu Sans", sans-serif`;
    context.textAlign = "center";
    context.textBaseline = "middle";
    if (ground) {
      context.strokeStyle = ground;
      context.lineWidth = size / 4;
      context.lineJoin = "round";
      context.strokeText(text, x, y);
    }
    context.fillStyle = ink;
    context.fillText(text, x, y);
  }

  // An arrow on the canvas between two world points, with an edge in the colour of the ground. Short ones are not drawn.
  arrow(from, to, style, edge, width) {
    const { context } = this;
    const [[x0, y0], [x1, y1]] = [from, to].map(this.project);
    const length = Math.hypot(x1 - x0, y1 - y0);
    const head = 2.6 * width;
    if (length < head) return false;
    const [dx, dy] = [(x1 - x0) / length, (y1 - y0) / length];
    const at = (along, aside) => [x0 + along * dx - aside * dy, y0 + along * dy + aside * dx];
    const outline = [at(0, width / 2), at(length - head, width / 2), at(length - head, head * 0.6), at(length, 0),
      at(length - head, -head * 0.6), at(length - head, -width / 2), at(0, -width / 2)];
    context.beginPath();
    for (const [x, y] of outline) context.lineTo(x, y);
    context.closePath();
    context.strokeStyle = edge;
    context.lineWidth = width / 2;
    context.lineJoin = "round";
    context.stroke();
    context.fillStyle = style;
    context.fill();
    return true;
  }
}
