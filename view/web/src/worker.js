// Worker's page: draws the view that decision.js derives. Levels, reasons and validity come from the daemon, texts from the
// tables.
import { Decider } from "./decision.js";
import { Figure2d } from "./figure2d.js";
import { Figure3d } from "./figure3d.js";
import { Hold } from "./hold.js";
import { setLevel } from "./levels.js";
import { drawMarks } from "./marks.js";
import { LIMB_REACHED_RAD, limbDeviations, agreement, movements, worstLimb } from "./match.js";
import { load, number } from "./numbers.js";
import { FRAMES_LOST_AFTER_MS, Stream, painter, setText } from "./stream.js";
import { applyTheme } from "./theme.js";
import { View } from "./view.js";
import { capitalised, instruction, language, languageSwitch, reason, t } from "./words.js";

// Faster changes are not readable.
const NUMBERS_EVERY_MS = 250;
const FATIGUE_ROWS = 3;
const FATIGUE_MIN = 0.01;
const PILL = { waiting: "ui.connecting", live: "ui.live", silent: "ui.no_data", lost: "ui.no_connection", ended: "ui.ended" };

const element = (id) => document.getElementById(id);
applyTheme(() => {
  figure.recolour();
  redraw();
});
const decider = new Decider();
const hold = new Hold();
let numbersShown = -Infinity;
let numbersOf = "";
// The cobot of a demonstration, which is displayed after the end too.
let cobot = null;

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
const stream = new Stream("/events", ["frame"], redraw, FRAMES_LOST_AFTER_MS);
const view = new View(element("figure"), showTurn);

function draw(now) {
  const shown = decider.decide(now, stream.connection, stream.newest());
  const { frame, faded } = shown.figure;
  const { width, height } = element("figure").getBoundingClientRect();
  view.update(frame, width, height);
  const posing = shown.posing && frame?.suggested && !faded;
  const reached = posing && frame.state.pose_mismatch_rad < frame.pose_reached_rad;
  const deviations = posing ? limbDeviations(frame.segment_origin_m, frame.suggested.segment_origin_m) : null;
  figure.draw(view, frame, faded, deviations, LIMB_REACHED_RAD);
  drawMarks(element("marks"), view, shown, posing && !reached ? movements(frame.segment_origin_m, frame.suggested.segment_origin_m, deviations) : [], language());
  showWords(shown);
  showHold(shown, now);
  // Without data no event ends the hold.
  if (shown.held) redraw();
  const situation = `${shown.kind} ${shown.held}`;
  if (now - numbersShown < NUMBERS_EVERY_MS && situation === numbersOf) return;
  [numbersShown, numbersOf] = [now, situation];
  showMatch(shown, deviations);
  showProgress(shown);
  showLoad(shown);
  showCobot(shown);
  showFatigue(shown.fatigue);
}

function showWords(shown) {
  const { dataset } = document.body;
  dataset.connection = stream.connection;
  dataset.phase = shown.phase;
  dataset.kind = shown.kind;
  dataset.held = String(Boolean(shown.held));
  setText(element("connection"), t(PILL[stream.connection]));
  setText(element("phase"), [shown.phase && t(`phase.${shown.phase}`), ...simulated(shown.figure.frame?.simulated)].filter(Boolean).join(" · "));
  element("stage").hidden = shown.kind === "ended";
  element("panels").hidden = shown.kind === "ended" && !cobot;
  element("results-card").hidden = shown.kind !== "ended";
  showResults(stream.results ?? []);
  setText(element("instruction"), instruction(shown.banner));
  element("banner").dataset.tone = shown.tone;
  element("badge").hidden = !shown.level;
  if (shown.level) setLevel(element("badge"), shown.level);
  element("no-picture").hidden = Boolean(shown.figure.frame);
  element("levels").hidden = shown.kind !== "load";
  element("poses-legend").hidden = !shown.posing;
  element("plate-legend").hidden = !shown.figure.frame;
  showReasons(shown.kind === "ended" ? [] : shown.reasons);
}

// Who is simulated in a demonstration, and what is lifted in truth.
function simulated(human) {
  if (!human) return [];
  const { height_m, mass_kg, box_kg } = human;
  const values = { height: number(height_m, 2, language()), mass: number(mass_kg, 0, language()) };
  return [t("ui.simulated", values), box_kg && t("ui.box", { mass: number(box_kg, 0, language()) })];
}

// The last results of a demonstration that has ended.
function showResults(results) {
  element("results-table").hidden = results.length === 0;
  const key = JSON.stringify([language(), results]);
  if (element("results").dataset.key === key) return;
  element("results").dataset.key = key;
  element("results").replaceChildren(...results.map((one) => {
    const row = document.createElement("tr");
    const withSigma = (value, sigma) => `${number(value, 1, language())}\u00a0±\u00a0${number(sigma, 1, language())}`;
    const cells = [...simulated(one.human), `${withSigma(one.load_kg, one.load_sigma_kg)}\u00a0kg`, capitalised(t(`joint.${one.joint}`)), `${withSigma(one.torque_nm, one.torque_sigma_nm)}\u00a0N\u00a0m`];
    row.append(...cells.map((text) => Object.assign(document.createElement("td"), { textContent: text })), levelCell(one.level));
    return row;
  }));
}

function levelCell(name) {
  const [cell, badge] = ["td", "i"].map((kind) => document.createElement(kind));
  badge.className = "badge";
  setLevel(badge, name);
  cell.append(badge, ` ${t(`level.${name}`)}`);
  return cell;
}

function showReasons(reasons) {
  element("reasons-card").hidden = reasons.length === 0;
  const lines = reasons.map(reason);
  const key = lines.join("\n");
  if (element("reasons").dataset.key === key) return;
  element("reasons").dataset.key = key;
  element("reasons").replaceChildren(...lines.map((line, i) => {
    const [what, ...rest] = line.split(": ");
    const item = document.createElement("li");
    const head = document.createElement("b");
    head.textContent = `${reasons[i].fault ? "! " : ""}${what}`;
    item.append(head, capitalised(rest.join(": ")));
    item.dataset.reason = reasons[i].name;
    item.classList.toggle("fault", reasons[i].fault);
    return item;
  }));
}

function showHold({ posing, held, figure: { frame } }, now) {
  const state = frame?.state;
  const reached = posing && !held && state.pose_mismatch_rad < frame.pose_reached_rad;
  const { remainingS, fraction: filled, done } = hold.update(now, {
    origins: frame?.segment_origin_m, reached, isStatic: state?.static_pose, poses: state?.poses_used ?? null,
  });
  element("hold").hidden = !done && !reached;
  element("hold").dataset.state = done || filled === 1 ? "full" : "filling";
  element("hold-fill").style.strokeDashoffset = String(100 * (1 - (done ? 1 : filled)));
  setText(element("hold-left"), done ? "✓" : `${number(remainingS, 1, language())} s`);
  setText(element("hold-text"), t(done ? "ui.hold_done" : "ui.hold_still"));
}

function fill(bar, part) {
  bar.firstElementChild.style.width = `${(100 * part).toFixed(0)}%`;
  bar.dataset.state = part >= 1 ? "full" : "";
  bar.setAttribute("aria-valuenow", (100 * part).toFixed(0));
}

function showMatch({ posing, held, figure: { frame } }, deviations) {
  element("match-card").hidden = !posing;
  if (!posing) return;
  const part = held ? 0 : agreement(frame.state.pose_mismatch_rad, frame.pose_reached_rad);
  setText(element("match-share"), held ? "–" : `${(100 * part).toFixed(0)} %`);
  fill(element("match-bar"), part);
  const limb = !held && part < 1 && worstLimb(deviations);
  setText(element("match-words"), part >= 1 ? t("ui.match_good") : limb ? t("ui.match_limb", { limb: t(`limb.${limb}`) }) : "");
}

function showProgress({ calibrating, held, figure: { frame } }) {
  element("progress-card").hidden = !calibrating;
  if (!calibrating || held || !frame) return;
  const { state, cop_sigma_target_m: target } = frame;
  const sigma = state.predicted_cop_sigma_m;
  const part = state.converged ? 1 : sigma && target ? Math.min(0.99, target / sigma) : Math.min(0.9, state.poses_used / 8);
  const count = state.poses_used;
  setText(element("poses"), t(count === 0 ? "ui.progress_none" : count === 1 ? "ui.progress_one" : "ui.progress_many", { count }));
  fill(element("progress-bar"), part);
  const words = part >= 1 ? "done" : part > 0.75 ? "nearly" : part > 0.4 ? "half" : "early";
  setText(element("progress-words"), t(`ui.progress_${words}`));
}

function showLoad({ kind, loadKg, advice }) {
  element("load-card").hidden = kind !== "load";
  setText(element("load"), load(loadKg, language()));
  element("advice").hidden = !advice;
  setText(element("advice"), advice ? t(`advice.${advice}`) : "");
}

// Overload of the worst joint with the part of a demonstration's cobot, at the fixed and at the planned place. The arm is in
// front of the worker: it is seen from the side.
function showCobot({ kind, figure: { frame } }) {
  // Without a connection there is no frame.
  if (kind !== "ended" && frame) {
    if (Boolean(frame.cobot) !== Boolean(cobot)) views[cobot ? 0 : 1].click();
    cobot = frame.cobot;
  }
  element("cobot-card").hidden = !cobot;
  if (cobot) setText(element("cobot-part"), t("ui.cobot", { mass: number(cobot.part_kg, 0, language()) }));
  for (const place of ["before", "after"]) {
    const ratio = cobot?.[place]?.map((part) => number(100 * part, 0, language())).join(" ± ");
    setText(element(`cobot-${place}`), ratio ? `${ratio} %` : "–");
  }
}

function showFatigue(fatigue) {
  element("fatigue-card").hidden = !fatigue;
  const fatigued = Object.entries(fatigue ?? {}).filter(([, part]) => part >= FATIGUE_MIN).sort((a, b) => b[1] - a[1]).slice(0, FATIGUE_ROWS);
  const rows = fatigued.map(([joint, part]) => {
    const row = document.createElement("li");
    const bar = document.createElement("div");
    bar.className = "bar";
    bar.append(document.createElement("i"));
    const name = capitalised(t(`joint.${joint}`));
    row.append(name, Object.assign(document.createElement("b"), { textContent: `${(100 * part).toFixed(0)} %` }), bar);
    bar.setAttribute("role", "meter");
    bar.setAttribute("aria-label", name);
    fill(bar, Math.min(1, part));
    return row;
  });
  if (!rows.length) rows.push(Object.assign(document.createElement("li"), { textContent: t("ui.fatigue_none") }));
  element("fatigue").replaceChildren(...rows);
}

// A badge and a name for each level, highest first.
function showLevels() {
  element("levels").replaceChildren(...["above_max", "red", "orange", "green", "undecided", "none"].map((name) => {
    const [item, badge, text] = ["li", "i", "span"].map((kind) => document.createElement(kind));
    badge.className = "badge";
    setLevel(badge, name);
    text.textContent = t(`level.${name}`);
    item.append(badge, text);
    return item;
  }));
}

const views = [...document.querySelectorAll("[data-azimuth]")];
for (const button of views) button.addEventListener("click", () => view.look(Number(button.dataset.azimuth), "mirrored" in button.dataset));
function showTurn() {
  for (const button of views) button.setAttribute("aria-pressed", String(!view.turned && Number(button.dataset.azimuth) === view.azimuth));
  redraw();
}
views[0].click();
window.addEventListener("resize", redraw);
languageSwitch(element("languages"), () => {
  numbersShown = -Infinity;
  showLevels();
  redraw();
});
