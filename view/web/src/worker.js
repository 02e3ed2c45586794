// Worker's page. Levels, reasons and validity come from the daemon, texts from the tables.
import { JOINT, LEVELS } from "./body.js";
import { Figure2d } from "./figure2d.js";
import { Figure3d } from "./figure3d.js";
import { Hold } from "./hold.js";
import { LIMB_REACHED_RAD, limbDeviations, share, worstLimb } from "./match.js";
import { load } from "./numbers.js";
import { Stream, painter, setText } from "./stream.js";
import { capitalised, instruction, language, languageSwitch, reason, t } from "./words.js";

// Faster changes are not readable.
const NUMBERS_EVERY_MS = 250;
const FATIGUE_ROWS = 5;
const FATIGUE_MIN = 0.01;
const CONNECTION = {
  waiting: { pill: "ui.connecting", reason: "connecting", tone: "calm" },
  live: { pill: "ui.live" },
  silent: { pill: "ui.no_data", reason: "silent", tone: "warn" },
  lost: { pill: "ui.no_connection", reason: "lost", tone: "alarm" },
};

const element = (id) => document.getElementById(id);
const hold = new Hold();
let numbersShown = -Infinity;

// A canvas provides only one kind of context: without WebGL it is replaced.
function makeFigure() {
  try {
    const figure = new Figure3d(element("figure"));
    document.body.dataset.figure = "3d";
    return figure;
  } catch {
    const fresh = element("figure").cloneNode();
    element("figure").replaceWith(fresh);
    document.body.dataset.figure = "2d";
    element("flat-note").hidden = false;
    return new Figure2d(fresh);
  }
}

const figure = makeFigure();
const redraw = painter(draw);
const stream = new Stream("/events", ["frame"], redraw);

function draw(now) {
  const newest = stream.newest();
  // The suggested pose is drawn at the worker's position, and omitted while that is unavailable.
  const frame = newest && (newest.segment_origin_m ? newest : { ...newest, suggested: undefined });
  const deviations = frame?.suggested && frame.segment_origin_m
    ? limbDeviations(frame.segment_origin_m, frame.suggested.segment_origin_m) : null;
  figure.draw(frame, deviations, LIMB_REACHED_RAD);
  showWords(frame);
  showHold(frame, now);
  showWorstLabel(frame);
  if (now - numbersShown > NUMBERS_EVERY_MS || !frame) {
    numbersShown = now;
    showMatch(frame, deviations);
    showProgress(frame);
    showJoints(frame);
  }
}

function showWords(frame) {
  const connection = CONNECTION[stream.connection];
  const { dataset } = document.body;
  dataset.connection = stream.connection;
  dataset.phase = frame?.phase_name ?? "";
  dataset.posing = String(Boolean(frame?.suggested));
  setText(element("connection"), t(connection.pill));
  setText(element("phase"), frame ? t(`phase.${frame.phase_name}`) : "");
  const headline = frame ? instruction(frame.instruction) : connection.reason ? instruction({ key: `reason.${connection.reason}` }) : "";
  setText(element("instruction"), headline);
  element("instruction").dataset.tone = frame ? frame.instruction.tone : connection.tone ?? "calm";
  element("no-picture").hidden = Boolean(frame?.segment_origin_m);
  showReasons(frame ? frame.reasons : connection.reason ? [{ name: connection.reason, fault: stream.connection === "lost" }] : []);
}

function showReasons(reasons) {
  // These need no action and are in the headline already.
  const relevant = reasons.filter(({ name }) => !["not_identified", "below_load_threshold"].includes(name));
  // During an equipment fault, the other reasons are its consequences: omit them.
  const faults = relevant.filter(({ fault }) => fault);
  const shown = faults.length ? faults : relevant;
  element("reasons-card").hidden = shown.length === 0;
  const lines = shown.map(reason);
  const key = lines.join("\n");
  if (element("reasons").dataset.key === key) return;
  element("reasons").dataset.key = key;
  element("reasons").replaceChildren(...lines.map((line, i) => {
    const [what, ...rest] = line.split(": ");
    const item = document.createElement("li");
    const head = document.createElement("b");
    head.textContent = what;
    item.append(head, capitalised(rest.join(": ")));
    item.dataset.reason = shown[i].name;
    item.classList.toggle("fault", shown[i].fault);
    return item;
  }));
}

// Whether the worker should take a pose now.
const isPoseRequested = (frame) => Boolean(frame?.suggested && frame.phase_name !== "degraded" && frame.state.pose_mismatch_rad !== undefined && frame.segment_origin_m);

function showHold(frame, now) {
  const reached = isPoseRequested(frame) && frame.state.pose_mismatch_rad < frame.pose_reached_rad;
  const ring = hold.update(now, {
    origins: frame?.segment_origin_m, reached, isStatic: frame?.state.static_pose, poses: frame?.state.poses_used ?? null,
  });
  const shown = ring.done || reached;
  const full = ring.done || ring.share === 1;
  element("hold").hidden = !shown;
  element("hold").dataset.state = full ? "full" : "filling";
  element("hold-fill").style.strokeDashoffset = String(100 * (1 - (ring.done ? 1 : ring.share)));
  setText(element("hold-text"), t(ring.done ? "ui.hold_done" : ring.share > 0.3 ? "ui.hold_keep" : "ui.hold_still"));
}

function showWorstLabel(frame) {
  const worst = frame?.worst;
  const label = element("worst-label");
  const shown = Boolean(worst && frame.segment_origin_m && !["none", "green"].includes(worst.level));
  label.hidden = !shown;
  if (!shown) return;
  setText(label, `${capitalised(t(`joint.${worst.joint}`))}: ${t(`level.${worst.level}`)}`);
  label.dataset.level = worst.level;
  const [x, y] = figure.project(frame.segment_origin_m[JOINT.indexOf(worst.joint) + 1]);
  const { width } = figure.canvas.getBoundingClientRect();
  // Next to the body, if the space suffices.
  const [[middle], wide] = [figure.project(frame.segment_origin_m[0]), label.offsetWidth];
  const sides = [x + 50, x - 50 - wide];
  if (x < middle) sides.reverse();
  const left = sides.find((side) => side >= 8 && side + wide + 8 <= width) ?? Math.max(8, (width - wide) / 2);
  label.style.transform = `translate(${left.toFixed(0)}px, ${(y - label.offsetHeight / 2).toFixed(0)}px)`;
}

function fill(bar, part) {
  bar.firstElementChild.style.width = `${(100 * part).toFixed(0)}%`;
  bar.dataset.state = part >= 1 ? "full" : "";
  bar.setAttribute("aria-valuenow", (100 * part).toFixed(0));
}

function showMatch(frame, deviations) {
  element("match-card").hidden = !isPoseRequested(frame);
  if (!isPoseRequested(frame)) return;
  const part = share(frame.state.pose_mismatch_rad, frame.pose_reached_rad);
  setText(element("match-share"), `${(100 * part).toFixed(0)} %`);
  fill(element("match-bar"), part);
  const limb = part < 1 && worstLimb(deviations);
  setText(element("match-words"), part >= 1 ? t("ui.match_good") : limb ? t("ui.match_limb", { limb: t(`limb.${limb}`) }) : "");
}

function showProgress(frame) {
  const state = frame?.state;
  element("progress-card").hidden = frame?.phase_name !== "identifying";
  if (!state) return;
  const [sigma, target] = [state.predicted_cop_sigma_m, frame.cop_sigma_target_m];
  const part = state.converged ? 1 : sigma && target ? Math.min(0.99, target / sigma) : Math.min(0.9, state.poses_used / 8);
  const count = state.poses_used;
  setText(element("poses"), t(count === 0 ? "ui.progress_none" : count === 1 ? "ui.progress_one" : "ui.progress_many", { count }));
  fill(element("progress-bar"), part);
  const words = part >= 1 ? "done" : part > 0.75 ? "nearly" : part > 0.4 ? "half" : "early";
  setText(element("progress-words"), t(`ui.progress_${words}`));
}

function showJoints(frame) {
  const state = frame?.state;
  const shown = frame?.phase_name === "monitoring";
  element("joints-card").hidden = !shown;
  if (!shown) return;
  const worst = frame.worst;
  element("worst").hidden = !worst;
  if (worst) {
    const dot = element("worst").querySelector(".dot");
    dot.dataset.level = worst.level;
    setText(dot, LEVELS[worst.level]?.sign ?? "");
    setText(element("worst-name"), capitalised(t(`joint.${worst.joint}`)));
    setText(element("worst-level"), t(`level.${worst.level}`));
  }
  setText(element("joints-words"), worst ? "" : t("ui.joints_unloaded"));
  element("advice").hidden = !frame.advice_name;
  setText(element("advice"), frame.advice_name ? t(`advice.${frame.advice_name}`) : "");
  setText(element("load"), load(state.lifted_mass_kg, language()));
  showFatigue(state.fatigue ?? {});
}

function showFatigue(fatigue) {
  const fatigued = Object.entries(fatigue).filter(([, part]) => part >= FATIGUE_MIN).sort((a, b) => b[1] - a[1]).slice(0, FATIGUE_ROWS);
  const rows = fatigued.map(([joint, part]) => {
    const row = document.createElement("li");
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.append(document.createElement("i"));
    const name = capitalised(t(`joint.${joint}`));
    row.append(name, bar);
    row.dataset.joint = joint;
    bar.setAttribute("role", "meter");
    bar.setAttribute("aria-label", name);
    fill(bar, Math.min(1, part));
    return row;
  });
  if (!rows.length) {
    const none = document.createElement("li");
    none.className = "soft";
    none.textContent = t("ui.fatigue_none");
    rows.push(none);
  }
  element("fatigue").replaceChildren(...rows);
}

const views = [...document.querySelectorAll("[data-azimuth]")];
for (const view of views) {
  view.addEventListener("click", () => {
    figure.azimuth = Number(view.dataset.azimuth);
    figure.elevation = 12;
    figure.onturn();
  });
}
figure.onturn = () => {
  for (const view of views) view.setAttribute("aria-pressed", String(Number(view.dataset.azimuth) === figure.azimuth));
  redraw();
};
window.addEventListener("resize", redraw);
languageSwitch(element("languages"), () => {
  numbersShown = -Infinity;
  redraw();
});
