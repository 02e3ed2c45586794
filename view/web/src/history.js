// Curves of the identification of one worker on the engineer's page: points of the states, parameters of the filter.

// As many as the server stores.
const POINTS_MAX = 1200;
const POINT_EVERY_S = 0.5;
const COLUMNS = ["t", "variance_max_m2", "predicted_cop_sigma_m", "nis", "poses_used", "motion_samples_used"];

export class History {
  // `earlier`: the server's, from before the page was opened.
  constructor(earlier = {}) {
    for (const key of [...COLUMNS, "parameters"]) this[key] = earlier[key] ?? [];
  }

  addState(state) {
    const last = Object.fromEntries(COLUMNS.map((key) => [key, this[key].at(-1)]));
    // A lower time: the computer was restarted; fewer poses or samples: identification began again.
    if (["t", "poses_used", "motion_samples_used"].some((key) => state[key] < last[key])) Object.assign(this, new History());
    else if (state.t - last.t < POINT_EVERY_S) return;
    for (const key of COLUMNS) {
      this[key].push(state[key] ?? null);
      if (this[key].length > POINTS_MAX) this[key].shift();
    }
  }

  addFacts(facts) {
    // Without a daemon its worker is unknown, not another one.
    const subject = facts?.daemon?.subject ?? this.subject;
    if (this.subject !== undefined && subject !== this.subject) Object.assign(this, new History());
    this.subject = subject;
    const { parameters } = facts ?? {};
    const last = this.parameters.at(-1);
    if (!parameters || parameters.cycle === last?.cycle) return;
    // Other names: another reduction; a lower cycle: the daemon was restarted. Start a new chart in both cases.
    const same = last?.names.join() === parameters.names.join() && last.cycle < parameters.cycle;
    this.parameters = [...(same ? this.parameters.slice(-POINTS_MAX) : []), parameters];
  }
}
