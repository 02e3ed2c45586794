// Engineer's page: torques against limits, load, ground and low back with their uncertainty; in tabs identification, latency,
// sensors and commands.
import { ConvergenceChart, PhiChart, ResidualChart } from "./charts.js";
import { commands } from "./commands.js";
import { History } from "./history.js";
import { IncidentList, span } from "./incidents.js";
import { JointTable } from "./joints.js";
import { number } from "./numbers.js";
import { drawPlate, feetOf } from "./plate.js";
import { FRAMES_LOST_AFTER_MS, Stream, painter, setText } from "./stream.js";
import { explanations, tabs } from "./tabs.js";
import { applyTheme } from "./theme.js";
import { MISSING, quantities, withheldBy } from "./values.js";
import { has, instruction, language, languageSwitch, reason, t } from "./words.js";

const NUMBERS_EVERY_MS = 250;
// Adapters publish their health once a second.
const ADAPTER_SILENT_AFTER_S = 3;
const CONNECTION = { waiting: ["ui.connecting", "connecting"], live: ["ui.live"], silent: ["ui.no_data", "silent"], lost: ["ui.no_connection", "lost"], ended: ["ui.ended", "ended"] };

const element = (id) => document.getElementById(id);
let charts = null;
let history = new History();
let numbersShown = -Infinity;
let shownFacts = null;

const redraw = painter(draw);
const joints = new JointTable(element("joints"));
const incidents = new IncidentList(element("incidents"));
// As many as the residual has points.
const frames = new Stream("/events?hz=10", ["frame"], redraw, FRAMES_LOST_AFTER_MS);
const station = new Stream("/events/station", ["station"], redraw);

// Curves from before this page was opened.
fetch("/api/history").then((response) => (response.ok ? response.json() : null)).then((earlier) => {
  if (earlier) history = new History(earlier);
  redraw();
}).catch(() => { /* the curves then start now */ });

function draw(now) {
  const frame = frames.newest();
  const facts = station.newest();
  element("plate").style.visibility = frame ? "" : "hidden";
  element("plate").dataset.drawn = [frame?.state.cop_measured && "measured", frame?.state.cop_estimated && "estimated", frame && feetOf(frame).length && "support"].filter(Boolean).join(" ");
  if (frame) charts.residual.add(frame.state);
  drawPlate(element("plate"), frame, charts.residual.trail);
  if (now - numbersShown < NUMBERS_EVERY_MS && frame) return;
  numbersShown = now;
  if (facts !== shownFacts) history.addFacts(facts);
  if (frame) history.addState(frame.state);
  charts.residual.paint();
  charts.convergence.paint(history, frame?.cop_sigma_target_m);
  charts.phi.paint(history.parameters);
  element("phi-none").hidden = history.parameters.length > 0;
  showHead(frame, facts);
  showValues(frame);
  showIdentification(frame);
  showSensors(frame, facts);
  if (facts !== shownFacts) showFacts(facts);
  shownFacts = facts;
}

function showHead(frame, facts) {
  const [pill, reasonName] = CONNECTION[frames.connection];
  const { dataset } = document.body;
  dataset.connection = frames.connection;
  dataset.phase = frame?.phase_name ?? "";
  setText(element("connection"), t(pill));
  setText(element("station"), facts?.station ?? "");
  setText(element("subject-now"), facts?.daemon ? facts.daemon.subject || t("ui.unnamed") : "");
  setText(element("phase"), frame ? t(`phase.${frame.phase_name}`) : "");
  element("silent").hidden = !reasonName;
  setText(element("silent"), reasonName ? t(`reason.${reasonName}`) : "");
  const { cop_measured: a, cop_estimated: b, suit_com: suit } = frame?.state ?? {};
  setText(element("apart"), a && b ? `${number(1000 * Math.hypot(a[0] - b[0], a[1] - b[1]), 1, language())} mm` : missing(frame, a ? "cop_estimated" : "cop_measured"));
  element("suit-com-legend").hidden = !suit;
  const reasons = frame?.reasons ?? [];
  const key = reasons.map(({ name }) => name).join() + document.documentElement.lang;
  if (element("reasons").dataset.key === key) return;
  element("reasons").dataset.key = key;
  element("reasons").replaceChildren(...reasons.map((one) => {
    const item = document.createElement("li");
    item.textContent = instruction({ key: `reason.${one.name}`, text: one.text });
    item.title = reason(one);
    item.classList.toggle("fault", one.fault);
    return item;
  }));
}

// What is missing, without what to do.
const brief = (name) => (has(`reason.${name}`) ? instruction({ key: `reason.${name}` }) : t(`ui.${name}`));

const missing = (frame, set) => `${MISSING} ${brief(withheldBy(frames.connection, frame, set) || "not_available")}`;

function showValues(frame) {
  setText(element("joints-why"), frame?.state.joints ? "" : missing(frame, "torques"));
  joints.show(frame);
  const shown = quantities(frames.connection, frame, language());
  if (!element("values").children.length) element("values").append(...shown.map(() => fact()));
  shown.forEach(({ name, text, reason: why }, i) => {
    const [label, value, small] = element("values").children[i].querySelectorAll("dt, b, small");
    element("values").children[i].dataset.quantity = name;
    setText(label, t(`ui.${name}`));
    setText(value, text);
    setText(small, why && brief(why));
  });
}

function fact() {
  const [group, label, definition, value, why] = ["div", "dt", "dd", "b", "small"].map((kind) => document.createElement(kind));
  definition.append(value, why);
  group.append(label, definition);
  return group;
}

function showIdentification(frame) {
  const { nis, poses_used: poses, variance_max_m2: variance, predicted_cop_sigma_m: sigma } = frame?.state ?? {};
  const target = frame?.cop_sigma_target_m;
  const millimetres = (metres) => number(1000 * metres, 1, language());
  const none = missing(frame);
  setText(element("poses"), poses === undefined ? none : String(poses));
  setText(element("nis"), nis === undefined ? none : number(nis, 2, language()));
  setText(element("variance"), variance === undefined ? none : millimetres(Math.sqrt(variance)));
  setText(element("cop-sigma"), sigma === undefined ? none : `${millimetres(sigma)}${target ? ` (${t("ui.target")}: ${millimetres(target)})` : ""}`);
}

function showFacts(facts) {
  const suspicion = facts?.daemon?.model_mismatch;
  element("model").hidden = !suspicion;
  // The heading replaces the first half of the daemon's sentence.
  setText(element("model-what"), suspicion?.replace(/^the model no longer explains this worker's data: /, "") ?? "");
  element("model-report").hidden = !facts?.report;
  element("model-no-report").hidden = Boolean(facts?.report);
  element("report").hidden = !facts?.report;
  // Since the first of an unbroken sequence of viewers.
  const measured = { span: Number.isFinite(facts?.latency_span_s) ? span(facts.latency_span_s) : MISSING };
  setText(element("latency-title"), t("ui.latency", measured));
  const micro = (ns) => (ns / 1000).toFixed(ns < 100_000 ? 1 : 0);
  const stages = (facts?.latency?.stages ?? []).filter(({ count }) => count > 0);
  rows("latency", stages.map((one) => [one.stage, ...[one.p50_ns, one.p99_ns, one.p99_9_ns, one.max_ns].map(micro)]), stages.map(({ definition }) => definition));
  const { latency, daemon } = facts ?? {};
  const loop = [["cycles", latency?.cycles], ["deadlines", latency?.deadlines_missed], ["skipped", latency?.slots_skipped],
    ["faults", daemon?.loop_faults?.join(" + ")], ["subject", daemon && (daemon.subject || t("ui.unnamed"))]];
  element("loop").replaceChildren(...loop.flatMap(([name, value]) => [["dt", t(`ui.${name}`, measured)], ["dd", value ?? MISSING]].map(([kind, text]) =>
    Object.assign(document.createElement(kind), { textContent: text }))));
  incidents.show(facts?.incidents);
}

// Distinguishes a silent sensor (age of its newest sample in the loop) from a silent adapter (age of its health message).
function showSensors(frame, facts) {
  const streams = ["suit", "ground"].map((stream) => {
    const ageNs = frame?.state[`${stream}_age_ns`];
    const health = facts?.adapters?.find((one) => one.stream === stream);
    const silent = health && health.age_s > ADAPTER_SILENT_AFTER_S;
    const adapter = silent ? t("ui.adapter_silent", { span: span(health.age_s) }) : health ? t("ui.adapter_speaks") : MISSING;
    const current = health && !silent;
    const stale = frame?.reasons.some(({ name }) => name === `${stream}_stale`);
    return {
      faults: [false, Boolean(stale), Boolean(silent)],
      cells: [t(`ui.${stream}`), ageNs === undefined ? MISSING : age(ageNs * 1e-9), adapter, current ? `${health.rate_hz.toFixed(0)} Hz` : MISSING, health?.lost ?? MISSING, health?.refused ?? MISSING],
    };
  });
  const key = JSON.stringify(streams);
  if (element("sensors").dataset.key === key) return;
  element("sensors").dataset.key = key;
  rows("sensors", streams.map(({ cells }) => cells));
  streams.forEach(({ faults }, i) => faults.forEach((fault, k) => element("sensors").rows[i].cells[k].classList.toggle("fault", fault)));
}

const age = (seconds) => (seconds < 1 ? `${(1000 * seconds).toFixed(1)} ms` : span(seconds));

function rows(id, table, notes = []) {
  element(id).replaceChildren(...table.map((cells, i) => {
    const row = document.createElement("tr");
    row.append(...cells.map((text, k) => Object.assign(document.createElement(k ? "td" : "th"), { textContent: text })));
    row.cells[0].scope = "row";
    if (notes[i]) row.cells[0].append(Object.assign(document.createElement("small"), { textContent: notes[i] }));
    return row;
  }));
}

function makeCharts() {
  for (const id of ["residual", "convergence", "phi"]) element(id).replaceChildren();
  const words = (names) => Object.fromEntries(names.map((name) => [name, t(`ui.${name}`)]));
  charts = {
    residual: new ResidualChart(element("residual"), words(["forward", "left", "noise"]), charts?.residual.rows),
    convergence: new ConvergenceChart(element("convergence"), words(["variance", "cop_sigma", "target"])),
    phi: new PhiChart(element("phi")),
  };
}

window.addEventListener("resize", redraw);
applyTheme(() => {
  makeCharts();
  redraw();
});
tabs(element("tabs"));
explanations();
languageSwitch(element("languages"), () => {
  makeCharts();
  numbersShown = -Infinity;
  shownFacts = undefined;
  redraw();
});
commands(element);
