// Listens to the service and shows what it says. Words, levels and validity come from there.
import { LEVEL_WORD, magnitude } from "./body.js";
import { Figure } from "./figure.js";
import { drawPlate } from "./plate.js";

const ROWS = [
  ["Shoulder", "LeftShoulder", "RightShoulder"],
  ["Elbow", "LeftElbow", "RightElbow"],
  ["Lower back", "L5S1"],
  ["Hip", "LeftHip", "RightHip"],
  ["Knee", "LeftKnee", "RightKnee"],
  ["Ankle", "LeftAnkle", "RightAnkle"],
];
// The service speaks 30 times a second, and once a second when it has nothing to say.
const LOST_AFTER_MS = 2500;
// Numbers that change faster than this cannot be read.
const NUMBERS_EVERY_MS = 200;

const element = (id) => document.getElementById(id);
const figure = new Figure(element("figure"));

let frame = null;
let connection = "waiting";
let heard = performance.now();
let numbersShown = -Infinity;
let source = null;

function connect() {
  source = new EventSource("/events");
  source.addEventListener("frame", (event) => {
    frame = JSON.parse(event.data);
    hear("live");
  });
  source.addEventListener("silent", () => hear("silent"));
  source.addEventListener("error", () => become("lost"));
}

function hear(state) {
  heard = performance.now();
  become(state);
  redraw();
}

function become(state) {
  if (state !== "live") frame = null; // never show what may no longer be true
  if (state === connection) return;
  connection = state;
  numbersShown = -Infinity;
  redraw();
}

// The browser tries again by itself, but gives up after some errors, and does not notice a frozen service.
setInterval(() => {
  if (performance.now() - heard > LOST_AFTER_MS) become("lost");
  if (connection === "lost" && source.readyState === EventSource.CLOSED) connect();
}, 1000);

let asked = false;
function redraw() {
  if (asked) return;
  asked = true;
  requestAnimationFrame((now) => {
    asked = false;
    figure.draw(frame);
    drawPlate(element("plate"), frame);
    showWords();
    if (now - numbersShown > NUMBERS_EVERY_MS || !frame) {
      numbersShown = now;
      showNumbers();
    }
  });
}

const CONNECTION = {
  waiting: ["connecting", "Connecting to the service", "calm"],
  live: ["live", "", "calm"],
  silent: ["no data", "The service says nothing: does it run?", "warn"],
  lost: ["no connection", "No connection to the service", "alarm"],
};

function showWords() {
  const [pill, headline, tone] = CONNECTION[connection];
  document.body.dataset.connection = connection;
  document.body.dataset.phase = frame?.state.phase ?? "";
  say("connection", pill);
  say("phase", frame ? frame.phase : "");
  say("instruction", frame ? frame.instruction.text : headline);
  element("instruction").dataset.tone = frame ? frame.instruction.tone : tone;
  element("ghost-legend").hidden = !frame?.suggested;
  const reasons = frame ? frame.reasons : connection === "lost" ? [LOST] : [];
  element("reasons-card").hidden = reasons.length === 0;
  const key = reasons.map((reason) => reason.name).join();
  if (element("reasons").dataset.key !== key) {
    element("reasons").dataset.key = key;
    element("reasons").replaceChildren(...reasons.map((reason) => {
      const item = document.createElement("li");
      item.textContent = reason.text;
      item.classList.toggle("fault", reason.fault);
      return item;
    }));
  }
}

const LOST = { name: "lost", fault: true, text: "The page hears nothing from Equipoise: is the service running? It tries again by itself." };

function showNumbers() {
  const state = frame?.state;
  const millimetres = (metres) => (metres === undefined ? "–" : `±${(1000 * metres).toFixed(0)} mm`);
  const sigma = state?.predicted_cop_sigma_m;
  const target = frame?.cop_sigma_target_m;
  say("poses", state ? `${state.poses_used}${state.converged ? " ✓" : ""}` : "–");
  say("sigma", millimetres(sigma));
  say("target", millimetres(target));
  const mass = state?.valid.includes("below_load_threshold") && state.delta_f_n ? 0 : state?.lifted_mass_kg;
  say("load", mass === undefined ? "–" : `${mass.toFixed(1)} kg`);
  showExposure(state);
  element("progress").value = state?.converged ? 1 : sigma && target ? Math.min(0.99, target / sigma) : 0;
  showJoints(state?.joints);
  describe(state);
}

// What ergonomists look at: the low back, the most loaded joint, what has added up, what would help.
function showExposure(state) {
  const { l5s1_compression_n: force, l5s1_compression_sigma_n: sigma, lifts } = state ?? {};
  say("back", force === undefined ? "–" : `${(force / 1000).toFixed(1)} ± ${((sigma ?? 0) / 1000).toFixed(1)} kN`);
  const worst = frame?.worst;
  say("tired-joint", worst ? `Tired: ${worst.text}` : "Most loaded joint");
  say("tired", worst?.fatigue === undefined ? "–" : `${(100 * worst.fatigue).toFixed(0)} %`);
  say("lifts", lifts === undefined ? "–" : String(lifts));
  element("advice").hidden = !frame?.advice;
  say("advice", frame?.advice ?? "");
}

function showJoints(joints) {
  element("joints").replaceChildren(...ROWS.map(([title, ...names]) => {
    const row = document.createElement("tr");
    const head = document.createElement("th");
    head.scope = "row";
    head.textContent = title;
    row.append(head, ...names.map((name) => jointCell(joints?.[name], names.length)));
    row.classList.toggle("worst", names.includes(frame?.worst?.joint));
    return row;
  }));
}

function jointCell(joint, columns) {
  const cell = document.createElement("td");
  if (columns === 1) cell.colSpan = 2;
  if (!joint) {
    cell.textContent = "–";
    return cell;
  }
  const dot = document.createElement("i");
  dot.className = "dot";
  dot.dataset.level = joint.level;
  const value = document.createElement("b");
  value.textContent = magnitude(joint.torque_nm).toFixed(0);
  const rest = document.createElement("small");
  const sigma = joint.sigma_nm === undefined ? "" : ` ± ${joint.sigma_nm.toFixed(0)}`;
  rest.textContent = `${sigma} ${LEVEL_WORD[joint.level] ?? joint.level}`;
  cell.append(dot, value, rest);
  return cell;
}

// What the drawings show, for those who do not see them.
function describe(state) {
  const worst = frame?.worst;
  const shown = !frame ? "Nothing is shown." : worst ? `Worst joint: ${worst.text}, ${LEVEL_WORD[worst.level]}.` : "No values.";
  element("figure").setAttribute("aria-label", `Stick figure of the worker; arrow keys turn it. ${shown}`);
  const { cop_measured: a, cop_estimated: b } = state ?? {};
  const apart = a && b ? `${(1000 * Math.hypot(a[0] - b[0], a[1] - b[1])).toFixed(0)} millimetres apart` : "not both known";
  element("plate").setAttribute("aria-label", `Plate from above. Measured and estimated centre of pressure: ${apart}.`);
}

function say(id, text) {
  // Unchanged text is left alone: screen readers would read it again.
  if (element(id).textContent !== text) element(id).textContent = text;
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
window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", redraw);

connect();
redraw();
