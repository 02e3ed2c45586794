"""Headless Chromium over its debugging pipe, without another library: opens a page, reads what it shows, checks and pictures it.

With PAGE_SHOTS=DIRECTORY pictures are written there: NAME-WIDTH-THEME.png, and films NAME.webp (program img2webp). AXE names the file axe.min.js of axe-core.
"""

import base64
import fcntl
import json
import os
import select
import subprocess
import tempfile
import time

# Time in which a resized page must be as it stays, s.
LAYOUT_S = 10.0
SHOTS = os.environ.get("PAGE_SHOTS")
AXE = os.environ.get("AXE")
LOOK_S = 180.0
LANGUAGES = ("de", "it", "en")
TABLET, DESKTOP, PHONE = (1280, 800), (1920, 1080), (390, 844)
THEMES = ("light", "dark")
# Without pictures, each scene is checked once large and once small.
CHECKED = [(DESKTOP, "dark"), (PHONE, "light")]
PICTURED = [(size, theme) for size in (TABLET, DESKTOP, PHONE) for theme in THEMES]
# The worker's page at DESKTOP: smallest text, and height of the figure over that of the viewport.
TEXT_PX_MIN = 28
FIGURE_SHARE_MIN = 0.45
CHROMIUM = ["chromium", "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
            "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
            "--window-size=1280,800", "--remote-debugging-pipe"]

LOOK = """(() => {
  const text = (id) => document.getElementById(id)?.textContent ?? "";
  const shown = (id) => { const one = document.getElementById(id); return Boolean(one && !one.hidden); };
  const data = (id) => document.getElementById(id)?.dataset ?? {};
  const overlap = (selector) => {
    const boxes = [...document.querySelectorAll(selector)].map((one) => one.getBoundingClientRect()).filter(({ width }) => width);
    return boxes.some((a, i) => boxes.some((b, k) => i < k
      && Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1));
  };
  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  while (walker.nextNode()) {
    const parent = walker.currentNode.parentElement;
    if (walker.currentNode.textContent.trim() && parent.tagName !== "NOSCRIPT" && parent.checkVisibility()) texts.push(parent);
  }
  return JSON.stringify({
    ...document.body?.dataset, frozen: Boolean(window.isFrozen), phaseText: text("phase"), instruction: text("instruction"),
    drawn: data("marks").drawn ?? "", triangles: Number(data("figure").triangles ?? 0), lang: document.documentElement.lang,
    figureShare: Number(data("marks").figurePx ?? 0) / innerHeight,
    textPx: Math.min(...texts.map((one) => parseFloat(getComputedStyle(one).fontSize))),
    clipped: texts.filter((one) => getComputedStyle(one).display !== "inline" && one.clientWidth && one.scrollWidth > one.clientWidth + 1).map((one) => one.textContent.trim()),
    outside: texts.filter((one) => {
      const [box, card] = [one, one.closest(".chart, .card, .notice, .banner, [role=tooltip]")].map((each) => each?.getBoundingClientRect());
      return card && box.width && (box.left < card.left - 1 || box.right > card.right + 1 || box.top < card.top - 1 || box.bottom > card.bottom + 1);
    }).map((one) => one.textContent.trim()),
    link: document.querySelector(".other, #summary")?.textContent ?? "", hold: shown("hold"), match: shown("match-card"), progress: shown("progress-card"),
    loaded: shown("load-card"), fatigue: shown("fatigue-card"), level: shown("badge") ? data("badge").level ?? "" : "",
    load: text("load"), results: [...document.querySelectorAll("#results tr")].map((row) => [...row.cells].map((cell) => cell.textContent)), advice: shown("advice") ? text("advice") : "", flat: shown("flat-note"),
    wide: document.documentElement.scrollWidth > document.documentElement.clientWidth,
    covered: overlap("header, .notice, .banner, .stage, .card, footer") || overlap(".values > div") || overlap("[role=tabpanel] > *") || overlap("header > *") || overlap(".legend, .views, .hold"), apart: parseFloat(text("apart")) || 0,
    reasons: [...document.querySelectorAll("#reasons li")].map((li) => li.dataset.reason ?? li.textContent),
    plate: data("plate").drawn ?? "", residual: Number(data("residual").points ?? 0),
    convergence: Number(data("convergence").points ?? 0), parameters: Number(document.querySelector("#phi")?.dataset.curves ?? 0),
    latency: document.querySelectorAll("#latency tr").length, sensors: [...document.querySelectorAll("#sensors tr")].map((row) => [...row.cells].map((cell) => cell.textContent)),
    tiles: [...document.querySelectorAll("#stations > li")].map((one) => ({ ...one.dataset, text: one.textContent })),
    model: shown("model") ? text("model-what") : "",
    quantities: Object.fromEntries([...document.querySelectorAll("[data-quantity]")].map((one) => [one.dataset.quantity, ["b", "small"].map((kind) => one.querySelector(kind).textContent)])),
    joints: [...document.querySelectorAll("#joints tr")].map((row) => row.querySelector(".torque").textContent), jointsWhy: text("joints-why"),
    tab: document.querySelector("[role=tab][aria-selected=true]")?.dataset.tab ?? "", token: `${data("token-state").kind ?? ""}: ${text("token-state")}`,
    workers: [...document.querySelectorAll("#subjects option")].map(({ value }) => value).filter(Boolean),
    incidents: [...document.querySelectorAll("#incidents li")].map((li) => li.dataset.incident ?? ""), incidentsText: text("incidents"),
    words: Object.fromEntries([...document.querySelectorAll("[data-t]")].map((one) => [one.dataset.t, one.textContent])),
    reply: `${data("reply").kind ?? ""}: ${text("reply")}`,
    disabled: document.querySelectorAll("[data-command]:disabled").length,
    busy: document.querySelectorAll("[data-command][aria-disabled=true]").length,
  });
})()"""

NOTHING = {"connection": None, "frozen": False, "phase": "", "phaseText": "", "instruction": "", "drawn": "", "triangles": 0, "figure": "", "figureShare": 0.0,
           "textPx": 0.0, "clipped": [], "outside": [], "lang": "", "link": "", "hold": False, "match": False, "progress": False, "loaded": False, "fatigue": False,
           "level": "", "load": "", "results": [], "advice": "", "flat": False, "wide": False, "covered": False, "apart": 0.0, "model": "", "tiles": [],
           "reasons": [], "plate": "", "residual": 0, "convergence": 0, "parameters": 0, "latency": 0, "sensors": [],
           "quantities": {}, "joints": [], "jointsWhy": "", "tab": "", "token": "", "workers": [], "incidents": [], "incidentsText": "", "words": {}, "reply": "", "disabled": 0, "busy": 0}

# Once the page shows the expected content, it receives the same data repeatedly: a picture takes longer than a pose is held.
# Frames and facts may be altered first: states of sensors and names that the simulation does not have.
FREEZE = """(() => {
  const Real = window.EventSource;
  let frozen = {};
  window.EventSource = class extends Real {
    addEventListener(name, listener) {
      super.addEventListener(name, (event) => {
        const alter = window.alter?.[event.type];
        if (alter) event = { type: event.type, data: JSON.stringify(alter(JSON.parse(event.data))) };
        if (event.type !== "frame") { listener(event); return; }
        if (!frozen.data && window.freezeWhen?.(this.last)) [frozen, window.isFrozen] = [{ data: this.last }, true];
        this.last = frozen.data ?? event.data;
        listener({ data: this.last });
      });
    }
  };
})()"""
AXE_RUN = """axe.run({ resultTypes: ["violations"] }).then(({ violations }) => JSON.stringify(violations
  .filter(({ impact }) => impact === "serious" || impact === "critical")
  .map(({ id, nodes }) => [id, ...nodes.slice(0, 3).map(({ target }) => target.join(" "))])))"""


class Ended(RuntimeError):
    """The observed service has ended."""


class Browser:
    """One tab of a Chromium process."""

    def __init__(self, profile, *more):
        to_browser, from_us = os.pipe()
        to_us, from_browser = os.pipe()
        # Away from descriptors 3 and 4, where Chromium expects its ends.
        reads = fcntl.fcntl(to_browser, fcntl.F_DUPFD, 10)
        writes = fcntl.fcntl(from_browser, fcntl.F_DUPFD, 10)
        os.close(to_browser)
        os.close(from_browser)
        from_us, to_us = (fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (from_us, to_us))

        def place():
            os.dup2(reads, 3)
            os.dup2(writes, 4)

        self.process = subprocess.Popen([*CHROMIUM, *more, f"--user-data-dir={profile}", "about:blank"], preexec_fn=place,
                                        pass_fds=(3, 4), stderr=subprocess.DEVNULL)
        os.close(reads)
        os.close(writes)
        self.to, self.of = from_us, to_us
        self.server = None
        self.buffer, self.number, self.method, self.errors, self.session = b"", 0, "", [], None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.ask(f"{domain}.enable")
        # Pictures have no scroll bar, whose width would be cut off.
        self.ask("Emulation.setScrollbarsHidden", hidden=True)
        self.show(TABLET, "light")

    def ask(self, method, **params):
        self.number += 1
        self.method = method
        message = {"id": self.number, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        os.write(self.to, json.dumps(message).encode() + b"\0")
        until = time.monotonic() + 30.0
        while True:
            answer = self.next_message(until)
            if answer.get("method") == "Runtime.exceptionThrown":
                self.errors.append(str(answer["params"]["exceptionDetails"].get("exception", {}).get("description", "exception")))
            if answer.get("id") == self.number:
                if "error" in answer:
                    raise RuntimeError(f"{method}: {answer['error']}")
                return answer["result"]

    def next_message(self, until):
        while b"\0" not in self.buffer:
            ready, _, _ = select.select([self.of], [], [], max(0.0, until - time.monotonic()))
            chunk = os.read(self.of, 1 << 16) if ready else b""
            if not chunk:
                raise RuntimeError("the browser has ended" if ready else f"the browser did not answer request {self.number} ({self.method}) in 30 s")
            self.buffer += chunk
        line, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(line)

    def look(self):
        # Between two documents the page is empty.
        return NOTHING | json.loads(self.run(LOOK) or "{}")

    def look_until(self, wanted, what, patience_s=LOOK_S):
        until = time.monotonic() + patience_s
        while not wanted(seen := self.look()):
            if self.server and self.server.poll() is not None:
                raise Ended(f"the service ended before the page showed {what}")
            if time.monotonic() > until:
                raise RuntimeError(f"the page never showed {what}; it shows {seen}")
            time.sleep(0.1)
        return seen

    def run(self, script):
        return self.ask("Runtime.evaluate", expression=script, awaitPromise=True)["result"].get("value")

    def open(self, url, freeze_when="null", alter="null"):
        script = f"{FREEZE}; window.freezeWhen = {freeze_when}; window.alter = {alter};"
        # An address that differs only in its fragment would not be loaded again.
        self.ask("Page.navigate", url="about:blank")
        once = self.ask("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        self.ask("Page.navigate", url=url)
        self.look_until(lambda seen: seen["lang"], url)
        self.ask("Page.removeScriptToEvaluateOnNewDocument", identifier=once)

    def click(self, selector):
        # Read before the click: a command's buttons are inactive until its reply.
        script = f"(() => {{ const e = document.querySelector({json.dumps(selector)}); const able = Boolean(e) && !e.disabled; e?.click(); return able; }})()"
        if not self.run(script):
            raise RuntimeError(f"nothing to click at {selector}")

    def type(self, field, text):
        self.run(f"(() => {{ const e = document.getElementById('{field}'); e.value = {json.dumps(text)}; "
                 "e.dispatchEvent(new Event('input')); })()")

    def show(self, size, theme):
        width, height = size
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)
        self.ask("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": theme}])

    def select_language(self, language):
        self.click(f"[data-language={language}]")
        return self.look_until(lambda seen: seen["lang"] == language, f"language {language}")

    def shoot(self, name):
        """Checks a scene at several sizes and in both themes, and pictures it. A name that ends in -de or -it is of that language."""
        ending = name.rsplit("-", 1)[-1]
        language = ending if ending in LANGUAGES else "en"
        for size, theme in PICTURED if SHOTS else CHECKED:
            self.show(size, theme)
            # Charts and figure follow the size.
            time.sleep(1.0)
            scene = f"{name}-{size[0]}-{theme}"
            self.check(scene, size, language)
            if SHOTS:
                self.keep(scene)
        self.show(TABLET, "light")

    def check(self, scene, size, language):
        # A busy machine lays the page out late: what is wrong must last.
        deadline_s = time.monotonic() + LAYOUT_S
        while (found := self.faults(size, language)) and time.monotonic() < deadline_s:
            time.sleep(0.5)
        if found:
            raise RuntimeError(f"{scene}: {'; '.join(found)}")

    def faults(self, size, language):
        """What is wrong with the page as it is now."""
        seen = self.look()
        is_worker = bool(self.run("Boolean(document.getElementById('marks'))"))
        faults = {
            f"language {seen['lang']} instead of {language}": seen["lang"] != language,
            "content wider than the window": seen["wide"],
            "one part covers another": seen["covered"],
            f"clipped text: {seen['clipped']}": seen["clipped"],
            f"text outside its card: {seen['outside']}": seen["outside"],
            f"text of {seen['textPx']} px": is_worker and size == DESKTOP and seen["textPx"] < TEXT_PX_MIN,
            f"a figure of {seen['figureShare']:.2f} of the height": "worker" in seen["drawn"] and size == DESKTOP and seen["figureShare"] < FIGURE_SHARE_MIN,
            **{f"axe-core: {finding}": True for finding in self.axe()},
        }
        return [text for text, present in faults.items() if present]

    def axe(self):
        """Serious and critical findings of axe-core."""
        if not AXE:
            return []
        if not self.run("Boolean(window.axe)"):
            with open(AXE, encoding="utf-8") as file:
                self.run(f"{file.read()}; 0")
        return json.loads(self.run(AXE_RUN))

    def keep(self, name):
        """The whole page, beyond the window too."""
        whole = self.ask("Page.getLayoutMetrics")["cssContentSize"]
        data = self.ask("Page.captureScreenshot", format="png", captureBeyondViewport=True, clip={**whole, "scale": 1})["data"]
        with open(os.path.join(SHOTS, f"{name}.png"), "wb") as file:
            file.write(base64.b64decode(data))

    def film(self, name, lasts_s, period_s):
        """The window for a while, as an animated picture."""
        with tempfile.TemporaryDirectory() as folder:
            frames, begun_s = [], time.monotonic()
            while (at_s := time.monotonic() - begun_s) < lasts_s:
                path = os.path.join(folder, f"{len(frames)}.png")
                with open(path, "wb") as file:
                    file.write(base64.b64decode(self.ask("Page.captureScreenshot", format="png")["data"]))
                frames.append((at_s, path))
                time.sleep(max(0.0, at_s + period_s - (time.monotonic() - begun_s)))
            ends_s = [at_s for at_s, _ in frames[1:]] + [lasts_s]
            shown = [["-d", str(round(1000 * (end_s - at_s))), path] for (at_s, path), end_s in zip(frames, ends_s)]
            subprocess.run(["img2webp", "-loop", "0", "-lossy", "-q", "60", "-m", "6", *sum(shown, []), "-o", os.path.join(SHOTS, f"{name}.webp")],
                           check=True, stdout=subprocess.DEVNULL)

    def close(self):
        self.process.terminate()
        self.process.wait(20)
