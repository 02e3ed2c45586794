// Quantities of the engineer's page: each is a valid value with its σ, or the reason why there is none.
import { number } from "./numbers.js";

export const MISSING = "—";

const offline = (connection) => ({ waiting: "connecting", silent: "silent", lost: "lost", ended: "ended" })[connection] ?? "connecting";

// A dose is unavailable before the first lift.
const assessed = (state, value) => (state.dose_damage > 0 ? value : undefined);

// `set` is the set of flags that invalidates the value (`Validity::FLAG_SETS`); `flag` a single one; `unavailable` the
// name of a quantity that the sensors may lack.
const QUANTITIES = [
  { name: "load", set: "lifted_mass", unit: "kg", digits: 1, of: (state) => [state.lifted_mass_kg, state.lifted_mass_sigma_kg] },
  { name: "reach", set: "torques", unit: "m", digits: 2, of: (state) => [state.reach_m, state.reach_sigma_m] },
  { name: "external_force", set: "delta_f", unit: "N", digits: 0, of: (state) => [state.delta_f_n?.[2], state.delta_f_sigma_n] },
  { name: "vertical_force", set: "ground_force", unit: "N", digits: 0, of: (state) => [state.vertical_force_n] },
  { name: "shear", set: "ground_force", unavailable: "shear", unit: "N", digits: 0,
    of: ({ ground_force_n: force }) => [force && Math.hypot(force[0], force[1])] },
  { name: "mass", flag: "mass_unknown", unit: "kg", digits: 1, of: (state) => [state.mass_kg] },
  { name: "l5s1_moment", set: "low_back", unit: "N m", digits: 0, of: (state) => [state.l5s1_moment_nm, state.l5s1_moment_sigma_nm] },
  { name: "l5s1_compression", set: "low_back", unit: "N", digits: 0, of: (state) => [state.l5s1_compression_n, state.l5s1_compression_sigma_n] },
  { name: "lifts", unit: "", digits: 0, of: (state) => [state.lifts] },
  { name: "dose_damage", unit: "", digits: 2, significant: true, of: (state) => [assessed(state, state.dose_damage)] },
  { name: "dose_probability", unit: "%", digits: 1, of: (state) => [assessed(state, 100 * state.dose_probability)] },
];

// A value with its σ. Adding zero removes the sign of a rounded -0.3.
export function withSigma([value, sigma], digits, unit, language) {
  const text = (one) => number(Number(one.toFixed(digits)) + 0, digits, language);
  return [text(value), ...(sigma > 0 ? ["±", text(sigma)] : []), unit].filter(Boolean).join("\u00a0");
}

// Name of the reason why quantities of a set are withheld; "" if the set is valid.
export const withheldBy = (connection, frame, set) => (frame ? frame.withheld?.[set] ?? "" : offline(connection));

// All quantities: name, text, and for a missing value the name of the reason.
export function quantities(connection, frame, language) {
  return QUANTITIES.map(({ name, set, flag, unavailable, unit, digits, significant, of }) => {
    const parts = frame && of(frame.state);
    if (Number.isFinite(parts?.[0])) {
      const text = significant ? parts[0].toLocaleString(language, { maximumSignificantDigits: digits }) : withSigma(parts, digits, unit, language);
      return { name, text, reason: "" };
    }
    const lacking = frame?.state.unavailable?.includes(unavailable) ? "not_measured" : "not_available";
    const raised = frame?.state.valid?.includes(flag) ? flag : "";
    return { name, text: MISSING, reason: withheldBy(connection, frame, set) || raised || lacking };
  });
}

// Rows of the joints, which exist without values too: magnitude of the torque, σ, limit, limit ratio, fatigue.
export function jointRows(names, frame) {
  return names.map((name) => {
    const joint = frame?.state.joints?.[name];
    const fatigue = frame?.state.fatigue?.[name];
    if (!joint?.torque_nm.every(Number.isFinite)) return { name, level: "none", fatigue };
    const torque = Math.hypot(...joint.torque_nm);
    const limitRatio = (value) => (joint.limit_nm ? value / joint.limit_nm : undefined);
    return {
      name, level: joint.level, fatigue, torque, sigma: joint.sigma_nm, limit: joint.limit_nm, limitRatio: limitRatio(torque),
      limitRatioSigma: limitRatio(joint.sigma_nm ?? 0), isWorst: frame.state.worst_joint === name,
    };
  });
}
