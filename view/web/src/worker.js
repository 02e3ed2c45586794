// The worker's page: shows what the service says. Levels, reasons and validity come from there; words from the tables.
import { JOINT, LEVELS } from "./body.js";
import { Figure2d } from "./figure2d.js";
import { Figure3d } from "./figure3d.js";
import { Hold } from "./hold.js";
import { LIMB_REACHED_RAD, limbsOff, share, worstLimb } from "./match.js";
import { load } from "./numbers.js";
import { Stream, painter, say } from "./stream.js";
import { capitalised, instruction, language, languageSwitch, reason, t } from "./words.js";

// Numbers that change faster than this cannot be read.
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

// A canvas that was asked for one kind of context gives no other: a browser without WebGL gets a new one.
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
  // A pose to take is drawn where the worker stands: nowhere, while that is not known.
  const frame = newest && (newest.segment_origin_m ? newest : { ...newest, suggested: undefined });
  const off = frame?.suggested && frame.segment_origin_m
    ? limbsOff(frame.segment_origin_m, frame.suggested.segment_origin_m) : null;
  figure.draw(frame, off, LIMB_REACHED_RAD);
  showWords(frame);
  showHold(frame, now);
  showWorstLabel(frame);
  if (now - numbersShown > NUMBERS_EVERY_MS || !frame) {
    numbersShown = now;
    showMatch(frame, off);
    showProgress(frame);
    showJoints(frame);
  }
}

function showWords(frame) {
  const told = CONNECTION[stream.connection];
  const { dataset } = document.body;
  dataset.connection = stream.connection;
  dataset.phase = frame?.phase_name ?? "";
  dataset.posing = String(Boolean(frame?.suggested));
  say(element("connection"), t(told.pill));
  say(element("phase"), frame ? t(`phase.${frame.phase_name}`) : "");
  const headline = frame ? instruction(frame.instruction) : told.reason ? instruction({ key: `reason.${told.reason}` }) : "";
  say(element("instruction"), headline);
  element("instruction").dataset.tone = frame ? frame.instruction.tone : told.tone ?? "calm";
  element("no-picture").hidden = Boolean(frame?.segment_origin_m);
  showReasons(frame ? frame.reasons : told.reason ? [{ name: told.reason, fault: stream.connection === "lost" }] : []);
}

function showReasons(reasons) {
  // What is only to be known, not to be done, is in the large sentence already.
  const told = reasons.filter(({ name }) => !["not_identified", "below_load_threshold"].includes(name));
  // While equipment fails, what follows from it is no news and nothing that the worker could do.
  const faults = told.filter(({ fault }) => fault);
  const shown = faults.length ? faults : told;
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

// Whether a pose is asked for that the worker is to hold now.
const asked = (frame) => Boolean(frame?.suggested && frame.phase_name !== "degraded" && frame.state.pose_mismatch_rad !== undefined && frame.segment_origin_m);

function showHold(frame, now) {
  const reached = asked(frame) && frame.state.pose_mismatch_rad < frame.pose_reached_rad;
  const seen = hold.see(now, {
    origins: frame?.segment_origin_m, reached, still: frame?.state.static_pose, poses: frame?.state.poses_used ?? null,
  });
  const shown = seen.done || reached;
  const full = seen.done || seen.share === 1;
  element("hold").hidden = !shown;
  element("hold").dataset.state = full ? "full" : "filling";
  element("hold-fill").style.strokeDashoffset = String(100 * (1 - (seen.done ? 1 : seen.share)));
  say(element("hold-text"), t(seen.done ? "ui.hold_done" : seen.share > 0.3 ? "ui.hold_keep" : "ui.hold_still"));
}

function showWorstLabel(frame) {
  const worst = frame?.worst;
  const label = element("worst-label");
  const shown = Boolean(worst && frame.segment_origin_m && !["none", "green"].includes(worst.level));
  label.hidden = !shown;
  if (!shown) return;
  say(label, `${capitalised(t(`joint.${worst.joint}`))}: ${t(`level.${worst.level}`)}`);
  label.dataset.level = worst.level;
  const [x, y] = figure.project(frame.segment_origin_m[JOINT.indexOf(worst.joint) + 1]);
  const { width } = figure.canvas.getBoundingClientRect();
  // Beside the body, not across it, where there is room.
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

function showMatch(frame, off) {
  element("match-card").hidden = !asked(frame);
  if (!asked(frame)) return;
  const part = share(frame.state.pose_mismatch_rad, frame.pose_reached_rad);
  say(element("match-share"), `${(100 * part).toFixed(0)} %`);
  fill(element("match-bar"), part);
  const limb = part < 1 && worstLimb(off);
  say(element("match-words"), part >= 1 ? t("ui.match_good") : limb ? t("ui.match_limb", { limb: t(`limb.${limb}`) }) : "");
}

function showProgress(frame) {
  const state = frame?.state;
  element("progress-card").hidden = frame?.phase_name !== "identifying";
  if (!state) return;
  const [sigma, target] = [state.predicted_cop_sigma_m, frame.cop_sigma_target_m];
  const part = state.converged ? 1 : sigma && target ? Math.min(0.99, target / sigma) : Math.min(0.9, state.poses_used / 8);
  const count = state.poses_used;
  say(element("poses"), t(count === 0 ? "ui.progress_none" : count === 1 ? "ui.progress_one" : "ui.progress_many", { count }));
  fill(element("progress-bar"), part);
  const words = part >= 1 ? "done" : part > 0.75 ? "nearly" : part > 0.4 ? "half" : "early";
  say(element("progress-words"), t(`ui.progress_${words}`));
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
    say(dot, LEVELS[worst.level]?.sign ?? "");
    say(element("worst-name"), capitalised(t(`joint.${worst.joint}`)));
    say(element("worst-level"), t(`level.${worst.level}`));
  }
  say(element("joints-words"), worst ? "" : t("ui.joints_unloaded"));
  element("advice").hidden = !frame.advice_name;
  say(element("advice"), frame.advice_name ? t(`advice.${frame.advice_name}`) : "");
  say(element("load"), load(state.lifted_mass_kg, language()));
  showFatigue(state.fatigue ?? {});
}

function showFatigue(fatigue) {
  const tired = Object.entries(fatigue).filter(([, part]) => part >= FATIGUE_MIN).sort((a, b) => b[1] - a[1]).slice(0, FATIGUE_ROWS);
  const rows = tired.map(([joint, part]) => {
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
