// Table of the joints: overload torque ± σ against the limit.
import { JOINT } from "./body.js";
import { LEVELS, setLevel } from "./levels.js";
import { number } from "./numbers.js";
import { setText } from "./stream.js";
import { MISSING, jointRows, withSigma } from "./values.js";
import { capitalised, language, t } from "./words.js";

// The bars end at 125 % of the limit.
const SCALE_MAX = 1.25;
const percent = (limitRatio) => `${(100 * Math.min(1, Math.max(0, limitRatio / SCALE_MAX))).toFixed(1)}%`;

function make(kind, className, ...children) {
  const element = document.createElement(kind);
  if (className) element.className = className;
  element.append(...children);
  return element;
}

export class JointTable {
  constructor(body) {
    this.rows = JOINT.map((name) => {
      const [badge, fill, whisker] = [make("i", "badge"), make("i", "fill"), make("i", "whisker")];
      badge.setAttribute("role", "img");
      const bar = make("div", "bar", fill, whisker, make("i", "limit"));
      bar.setAttribute("aria-hidden", "true");
      const head = make("th", "", make("span"), make("small", "", name));
      head.scope = "row";
      const cells = ["torque", "limit", "fatigue"].map((kind) => make("td", kind));
      const row = make("tr", "", head, make("td", "level", badge), make("td", "share", bar), ...cells);
      return { row, label: head.firstChild, badge, fill, whisker, cells };
    });
    body.replaceChildren(...this.rows.map(({ row }) => row));
  }

  show(frame) {
    jointRows(JOINT, frame).forEach((joint, i) => {
      const { row, label, badge, fill, whisker, cells } = this.rows[i];
      setText(label, capitalised(t(`joint.${joint.name}`)));
      row.classList.toggle("worst", Boolean(joint.isWorst));
      setLevel(badge, joint.level);
      badge.setAttribute("aria-label", t(`level.${joint.level}`));
      badge.title = t(`level.${joint.level}`);
      const { limitRatio = 0, limitRatioSigma = 0 } = joint;
      fill.style.width = percent(limitRatio);
      fill.style.background = (LEVELS[joint.level] ?? LEVELS.none).colour;
      whisker.hidden = !limitRatioSigma;
      whisker.style.left = percent(limitRatio - limitRatioSigma);
      whisker.style.right = `calc(100% - ${percent(limitRatio + limitRatioSigma)})`;
      const texts = [
        joint.torque === undefined ? MISSING : withSigma([joint.torque, joint.sigma], 1, "", language()),
        joint.limit === undefined ? MISSING : number(joint.limit, 0, language()),
        joint.fatigue === undefined ? MISSING : `${(100 * joint.fatigue).toFixed(0)} %`,
      ];
      cells.forEach((cell, k) => setText(cell, texts[k]));
    });
  }
}
