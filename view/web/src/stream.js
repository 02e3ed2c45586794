// The service's event stream: the newest frame, or why there is none.

// The service speaks 60 times a second, and once a second when it has nothing to say.
const LOST_AFTER_MS = 2500;
// A connection whose other end is gone without a word stays open for a browser, for minutes: who hears nothing for so long
// asks anew, and gives every attempt as long.
const RENEWED_AFTER_MS = 5000;

export class Stream {
  // `changed` is called when something new is there; whoever draws asks for it when the screen is ready.
  constructor(address, names, changed) {
    this.address = address;
    this.names = names;
    this.changed = changed;
    this.connection = "waiting"; // or live, silent, lost
    this.frame = null;
    this.heard = performance.now();
    this.connect();
    // The browser tries again by itself, but gives up after some errors, and does not notice a frozen service.
    setInterval(() => {
      const now = performance.now();
      if (now - this.heard > LOST_AFTER_MS) this.become("lost");
      const mute = now - Math.max(this.heard, this.asked) > RENEWED_AFTER_MS;
      if (this.connection === "lost" && (mute || this.source.readyState === EventSource.CLOSED)) this.connect();
    }, 1000);
  }

  connect() {
    this.source?.close();
    this.asked = performance.now();
    this.source = new EventSource(this.address);
    for (const name of this.names) {
      this.source.addEventListener(name, (event) => {
        // Kept as text: of two that come between two pictures only the newer is read.
        this.text = event.data;
        this.hear("live");
      });
    }
    this.source.addEventListener("silent", () => this.hear("silent"));
    this.source.addEventListener("error", () => this.become("lost"));
  }

  hear(connection) {
    this.heard = performance.now();
    this.become(connection);
    this.changed();
  }

  become(connection) {
    if (connection !== "live") this.text = this.frame = null; // never show what may no longer be true
    if (connection === this.connection) return;
    this.connection = connection;
    this.changed();
  }

  // The newest frame, read when it is needed; `null` if there is none.
  newest() {
    if (this.text) [this.frame, this.text] = [JSON.parse(this.text), null];
    return this.frame;
  }
}

// Calls `draw` at the screen's pace, and only when asked.
export function painter(draw) {
  let asked = false;
  return () => {
    if (asked) return;
    asked = true;
    requestAnimationFrame((now) => {
      asked = false;
      draw(now);
    });
  };
}

// Unchanged text is left alone: screen readers would read it again.
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}
