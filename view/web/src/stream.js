// Event stream of the server: the newest frame, or the connection state if there is none.

// The server sends events at least once a second, also without data.
const LOST_AFTER_MS = 2500;
// Frames arrive 10 to 60 times a second, so a live stream of frames has this shorter limit.
export const FRAMES_LOST_AFTER_MS = 1000;
const CHECK_EVERY_MS = 100;
// A longer interval between two checks means that the page was busy, or that the browser throttles a hidden page.
const CHECK_PAUSED_MS = 500;
// Browsers detect a vanished peer only after minutes. Reconnect after this time without an event, counted
// from the start of each attempt.
const RECONNECT_AFTER_MS = 5000;
// A connection that the browser has closed is opened again after this time.
const CLOSED_FOR_MS = 1000;

export class Stream {
  // `changed` is called at each event; the drawing code reads `newest` when the screen is ready. A live stream is lost after
  // `liveFor` ms without an event.
  constructor(address, names, changed, liveFor = LOST_AFTER_MS) {
    this.address = address;
    this.names = names;
    this.changed = changed;
    this.connection = "waiting"; // or live, silent, lost, ended
    this.results = null; // of a demonstration that has ended
    this.frame = null;
    this.lastEventAt = this.checkedAt = performance.now();
    this.paused = false;
    this.connect();
    // A page that the browser keeps for its back button would keep its connection too, of which a browser opens six.
    addEventListener("pagehide", () => this.source.close());
    addEventListener("pageshow", ({ persisted }) => {
      if (!persisted || this.results) return;
      this.setConnection("waiting");
      this.connect();
    });
    // The browser reconnects automatically, but gives up after some errors and does not detect a frozen server.
    setInterval(() => {
      if (this.results) return;
      const now = performance.now();
      // After a pause of the page, skip one check, so that events that arrived meanwhile are processed first.
      const paused = now - this.checkedAt > CHECK_PAUSED_MS && !this.paused;
      [this.checkedAt, this.paused] = [now, paused];
      if (paused) return;
      if (now - this.lastEventAt > (this.connection === "live" ? liveFor : LOST_AFTER_MS)) this.setConnection("lost");
      const quietFor = now - Math.max(this.lastEventAt, this.attemptAt);
      const limit = this.source.readyState === EventSource.CLOSED ? CLOSED_FOR_MS : RECONNECT_AFTER_MS;
      if (this.connection === "lost" && quietFor > limit) this.connect();
    }, CHECK_EVERY_MS);
  }

  connect() {
    this.source?.close();
    this.attemptAt = performance.now();
    this.source = new EventSource(this.address);
    for (const name of this.names) {
      this.source.addEventListener(name, (event) => {
        // Parsed on demand: of several events between two screen refreshes only the newest is needed.
        this.text = event.data;
        this.receive("live");
      });
    }
    this.source.addEventListener("silent", () => this.receive("silent"));
    // The last event of a demonstration: its results stay, and no server to reconnect to.
    this.source.addEventListener("ended", (event) => {
      this.results = JSON.parse(event.data).results;
      this.source.close();
      this.receive("ended");
    });
    this.source.addEventListener("error", () => this.setConnection("lost"));
  }

  receive(connection) {
    this.lastEventAt = performance.now();
    this.setConnection(connection);
    this.changed();
  }

  setConnection(connection) {
    if (connection !== "live") this.text = this.frame = null; // stale data must not be displayed
    if (connection === this.connection) return;
    this.connection = connection;
    this.changed();
  }

  // The newest frame, or `null`.
  newest() {
    if (this.text) [this.frame, this.text] = [JSON.parse(this.text), null];
    return this.frame;
  }
}

// Returns a function that schedules one `draw` at the next screen refresh.
export function painter(draw) {
  let scheduled = false;
  return () => {
    if (scheduled) return;
    scheduled = true;
    requestAnimationFrame((now) => {
      scheduled = false;
      draw(now);
    });
  };
}

// Sets a text only if it differs: screen readers would repeat it.
export function setText(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
