// What the worker's page shows: banner, card and figure derive from one view of the connection and the newest frame.
//
// The server holds its headline for a second of a sensor's silence (view/src/banner.rs). The decider does the same for a
// lost connection and for withheld torques: the page keeps its words and layout, but no value and no advice.

export const HOLD_MS = 1000;
export const FAULTS = ["suit_stale", "ground_stale", "plate_fault"];
// Reasons that need no action and are in the banner already.
const UNLISTED = ["not_identified", "below_load_threshold"];
const OFFLINE = {
  waiting: { name: "connecting", tone: "calm" }, live: { name: "connecting", tone: "calm" },
  silent: { name: "silent", tone: "warn" }, lost: { name: "lost", tone: "alarm" }, ended: { name: "ended", tone: "calm" },
};
// Kind of page of one frame:
// `fault`, `waiting`, `pose` (to be taken and held), `load` (evaluated), `rest` (no load), `withheld` (torques invalid).
// Without a frame: `offline`, or `ended` after the last event of a demonstration.
function kindOf(frame) {
  const { state } = frame;
  if (frame.reasons.some(({ fault }) => fault)) return "fault";
  if (state.valid.some((name) => FAULTS.includes(name))) return "withheld";
  if (state.phase === "identifying") return "pose";
  if (state.phase !== "monitoring") return "waiting";
  if (frame.worst) return "load";
  if (isPoseRequested(frame)) return "pose";
  return state.valid.includes("below_load_threshold") ? "rest" : "withheld";
}

const isPoseRequested = ({ state, suggested, segment_origin_m: origins }) =>
  Boolean(suggested && origins && state.pose_mismatch_rad !== undefined);

function listed(reasons) {
  const relevant = reasons.filter(({ name }) => !UNLISTED.includes(name));
  // During an equipment fault, the other reasons are its consequences: omit them.
  const faults = relevant.filter(({ fault }) => fault);
  return faults.length ? faults : relevant;
}

// The view of one frame, without regard to earlier ones. `frame` is null while no data arrive.
export function viewOf(connection, frame) {
  if (!frame) {
    const { name, tone } = OFFLINE[connection];
    return {
      kind: connection === "ended" ? "ended" : "offline", gap: ["silent", "lost"].includes(connection), phase: "", tone, banner: { key: `reason.${name}` }, level: null,
      reasons: [{ name, fault: tone === "alarm" }], posing: false, calibrating: false, fatigue: null, advice: null, loadKg: null,
      figure: { frame: null, faded: false, levels: false },
    };
  }
  const { state } = frame;
  const kind = kindOf(frame);
  const level = kind === "load" ? frame.worst.level : null;
  return {
    kind, gap: kind === "withheld", phase: frame.phase_name, tone: frame.instruction.tone, banner: frame.instruction, level,
    reasons: kind === "load" ? [] : listed(frame.reasons),
    posing: kind === "pose" && isPoseRequested(frame),
    calibrating: kind === "pose" && state.phase === "identifying",
    // Zero until a load has been evaluated.
    fatigue: state.phase === "monitoring" && Object.values(state.fatigue ?? {}).some((part) => part > 0) ? state.fatigue : null,
    advice: kind === "load" ? frame.advice_name ?? null : null,
    loadKg: kind === "load" && state.lifted_mass_kg > 0 ? state.lifted_mass_kg : null,
    figure: { frame: frame.segment_origin_m ? frame : null, faded: false, levels: kind === "load" },
  };
}

export class Decider {
  // The view at `now` (ms). Through gaps of less than a second the last view without a gap is kept, without its values.
  decide(now, connection, frame) {
    const view = viewOf(connection, frame);
    if (!view.gap) {
      [this.last, this.since] = [view, now];
      return view;
    }
    if (!this.last || now - this.since >= HOLD_MS) return view;
    const live = Boolean(view.figure.frame);
    return {
      ...this.last, held: true, advice: null, loadKg: null,
      figure: { frame: live ? view.figure.frame : this.last.figure.frame, faded: !live, levels: false },
    };
  }
}
