"""Opens the pages in headless Chromium, clicks through them in every phase and looks at what they show.

page.py demo URL DEMO-COMMAND...          the demonstration: poses, hold still, a load, the service's death
page.py station URL EQUIPOISE CONFIG SUIT PLATE   a page next to daemon and person: every level, commands, silence, no WebGL

With PAGE_SHOTS=DIRECTORY the pictures are written there. A picture whose name ends in -de or -it is in that language, every
other in English, or the test fails.

Chromium is spoken to over its debugging pipe, so that nothing but Python's own library is needed. What the page's canvas
shows is reported by the code that draws it: which figure it draws, and how many triangles the graphics library drew.
"""

import base64
import fcntl
import json
import os
import pathlib
import select
import signal
import subprocess
import sys
import tempfile
import time
import urllib.request

SHOTS = os.environ.get("PAGE_SHOTS")
SECRET = "of-the-test-0123456789abcdefghij"
START_S = 60.0
LOOK_S = 180.0
TRIES = 4
LANGUAGES = ("de", "it", "en")
# A kiosk's tablet both ways, a phone, and a desktop on which the whole of the engineer's page is seen.
TABLET, UPRIGHT, PHONE, DESKTOP = (1280, 800), (800, 1280), (390, 844), (1280, 1220)
CHROMIUM = ["chromium", "--headless", "--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--disable-dev-shm-usage",
            "--disable-background-networking", "--disable-component-update", "--disable-sync", "--no-first-run",
            "--window-size=1280,800", "--remote-debugging-pipe"]

LOOK = """(() => {
  const text = (id) => document.getElementById(id)?.textContent ?? "";
  const shown = (id) => { const one = document.getElementById(id); return Boolean(one && !one.hidden); };
  const data = (id) => document.getElementById(id)?.dataset ?? {};
  const canvas = document.getElementById("figure");
  const boxes = [...document.querySelectorAll("header, .instruction, .stage, .card, footer")].map((one) => one.getBoundingClientRect()).filter(({ width }) => width);
  const covered = boxes.some((a, i) => boxes.some((b, k) => i < k
    && Math.min(a.right, b.right) - Math.max(a.left, b.left) > 1 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 1));
  return JSON.stringify({
    ...document.body?.dataset, phaseText: text("phase"), instruction: text("instruction"),
    drawn: canvas?.dataset.drawn ?? "", triangles: Number(canvas?.dataset.triangles ?? 0), lang: document.documentElement.lang,
    link: document.querySelector(".other")?.textContent ?? "", hold: shown("hold"), match: shown("match-card"), progress: shown("progress-card"), joints: shown("joints-card"),
    worst: shown("worst") ? text("worst-name") : "",
    level: shown("worst") ? document.querySelector("#worst .dot")?.dataset.level ?? "" : "",
    wide: document.documentElement.scrollWidth > document.documentElement.clientWidth, covered, apart: parseFloat(text("apart")) || 0,
    load: text("load"), flat: shown("flat-note"),
    reasons: [...document.querySelectorAll("#reasons li")].map((li) => li.dataset.reason ?? li.textContent),
    plate: data("plate").drawn ?? "", residual: Number(data("residual").points ?? 0),
    convergence: Number(data("convergence").points ?? 0), parameters: Number(document.querySelector("#phi")?.dataset.curves ?? 0),
    latency: document.querySelectorAll("#latency tr").length, sensors: [...document.querySelectorAll("#sensors tr")].map((row) => [...row.cells].map((cell) => cell.textContent)),
    model: shown("model") ? text("model-what") : "",
    incidents: [...document.querySelectorAll("#incidents li")].map((li) => li.dataset.incident ?? ""), incidentsText: text("incidents"),
    words: Object.fromEntries([...document.querySelectorAll("[data-t]")].map((one) => [one.dataset.t, one.textContent])),
    reply: `${data("reply").kind ?? ""}: ${text("reply")}`,
    disabled: document.querySelectorAll("[data-command]:disabled").length,
    busy: document.querySelectorAll("[data-command][aria-disabled=true]").length,
    nameless: [...document.querySelectorAll("[role=img], [role=meter], [role=progressbar]")].filter((one) => !one.getAttribute("aria-label")).length,
  });
})()"""

NOTHING = {"connection": None, "phase": "", "phaseText": "", "instruction": "", "drawn": "", "triangles": 0, "figure": "",
           "lang": "", "link": "", "hold": False, "match": False, "progress": False, "joints": False, "worst": "", "level": "", "wide": False, "covered": False, "apart": 0.0, "model": "", "load": "", "flat": False,
           "reasons": [], "plate": "", "residual": 0, "convergence": 0, "parameters": 0, "latency": 0, "sensors": [],
           "incidents": [], "incidentsText": "", "words": {}, "reply": "", "disabled": 0, "busy": 0, "nameless": 0}


# Once the page shows the expected content, it receives the same data repeatedly: a picture takes longer than a pose is held.
FREEZE = """(() => {
  const Real = window.EventSource;
  let frozen = {};
  window.EventSource = class extends Real {
    addEventListener(name, heard) {
      super.addEventListener(name, (event) => {
        if (event.type !== "frame") { heard(event); return; }
        if (!frozen.data && window.freezeWhen?.(this.last)) frozen = { data: this.last };
        this.last = frozen.data ?? event.data;
        heard({ data: this.last });
      });
    }
  };
})()"""
HOLDS = "() => { const one = document.getElementById('hold'); return one && !one.hidden && one.dataset.state === 'filling'; }"
LEVEL = "(last) => last && JSON.parse(last).worst?.level === '{}'"
POSING = "() => { const one = document.getElementById('match-card'); return one && !one.hidden && document.body.dataset.phase === 'identifying'; }"


class Ended(RuntimeError):
    """What is looked at ended by itself."""


class Browser:
    """One tab of a Chromium of its own."""

    def __init__(self, profile, *more):
        to_browser, from_us = os.pipe()
        to_us, from_browser = os.pipe()
        # Out of the way of 3 and 4, where Chromium expects its ends.
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
        self.buffer, self.number, self.errors, self.session = b"", 0, [], None
        target = self.ask("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Runtime", "Log", "Page"):
            self.ask(f"{domain}.enable")

    def ask(self, method, **params):
        self.number += 1
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
                raise RuntimeError("the browser does not answer")
            self.buffer += chunk
        line, self.buffer = self.buffer.split(b"\0", 1)
        return json.loads(line)

    def look(self):
        # Between two documents there is little or nothing to look at.
        value = self.ask("Runtime.evaluate", expression=LOOK)["result"].get("value")
        return NOTHING | json.loads(value or "{}")

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
        return self.ask("Runtime.evaluate", expression=script)["result"].get("value")

    def open(self, url, freeze_when="null"):
        script = f"{FREEZE}; window.freezeWhen = {freeze_when};"
        once = self.ask("Page.addScriptToEvaluateOnNewDocument", source=script)["identifier"]
        self.ask("Page.navigate", url=url)
        self.look_until(lambda seen: seen["lang"], url)
        self.ask("Page.removeScriptToEvaluateOnNewDocument", identifier=once)

    def click(self, selector):
        # Asked before the click: a command's buttons rest until its answer is there.
        script = f"(() => {{ const e = document.querySelector({json.dumps(selector)}); const able = Boolean(e) && !e.disabled; e?.click(); return able; }})()"
        if not self.run(script):
            raise RuntimeError(f"there is nothing to click at {selector}")

    def type(self, field, text):
        self.run(f"(() => {{ const e = document.getElementById('{field}'); e.value = {json.dumps(text)}; "
                 "e.dispatchEvent(new Event('input')); })()")

    def size(self, size):
        width, height = size
        self.ask("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def say_in(self, language):
        self.click(f"[data-language={language}]")
        return self.look_until(lambda seen: seen["lang"] == language, f"language {language}")

    def shoot(self, name):
        seen, ending = self.look(), name.rsplit("-", 1)[-1]
        if seen["lang"] != (ending if ending in LANGUAGES else "en"):
            raise RuntimeError(f"the picture {name} would be in language {seen['lang']}")
        if seen["wide"] or seen["covered"]:
            raise RuntimeError(f"the page of {name} is wider than its window, or one part of it covers another")
        if seen["nameless"]:
            raise RuntimeError(f"{seen['nameless']} pictures or bars of {name} have no name for who cannot see them")
        if SHOTS:
            self.keep(name)

    def shoot_whole(self, name, size=DESKTOP):
        """At another size, when the charts have found theirs."""
        self.size(size)
        time.sleep(1.5)
        self.shoot(name)
        self.size(TABLET)

    def keep(self, name):
        data = self.ask("Page.captureScreenshot", format="png")["data"]
        with open(os.path.join(SHOTS, f"{name}.png"), "wb") as file:
            file.write(base64.b64decode(data))

    def close(self):
        self.process.terminate()
        self.process.wait(20)


def wait_for(url, server):
    until = time.monotonic() + START_S
    while time.monotonic() < until:
        if server.poll() is not None:
            raise RuntimeError(f"the service ended with {server.returncode} before it served {url}")
        try:
            return urllib.request.urlopen(url, timeout=2).read()
        except OSError:
            time.sleep(0.2)
    raise RuntimeError(f"{url} was not served within {START_S} s")


def says(text):
    print(f"page: {text}", flush=True)


def nothing_shown(seen):
    return not seen["phase"] and not seen["drawn"]


def is_live(seen):
    return seen["connection"] == "live" and seen["phase"] and seen["phaseText"] and "worker" in seen["drawn"]


def in_3d(seen):
    return is_live(seen) and seen["figure"] == "3d" and seen["triangles"] > 1000


def languages(browser):
    """Every sentence that is shown changes with the language, and comes back."""
    links = {}
    for language in LANGUAGES:
        seen = browser.say_in(language)
        table = json.loads(pathlib.Path(f"view/src/words/{language}.json").read_text(encoding="utf-8"))
        wrong = {key: text for key, text in seen["words"].items() if text != table[key]}
        if wrong or not seen["words"]:
            raise RuntimeError(f"not what the table of {language} says: {wrong or 'no words at all'}")
        links[language] = seen["link"]
    if len(set(links.values())) != 3:
        raise RuntimeError(f"the same words in three languages: {links}")
    return links


def end(browser, server, url):
    browser.server = None
    server.kill()
    server.wait()
    gone = browser.look_until(lambda seen: seen["connection"] in ("lost", "silent") and nothing_shown(seen), "that the service is gone")
    says(f"after the service at {url} was killed: \"{gone['instruction']}\", and no figure")


def demo(browser, start, url, *command):
    """Each scene from the beginning; again if the browser was too late on a slow machine, since the person does not wait."""
    for scene in (poses, learnt_and_loaded):
        for attempt in range(TRIES):
            server = start(*command)
            wait_for(url, server)
            browser.server = server
            try:
                scene(browser, url)
                break
            except Ended as ended:
                if attempt + 1 == TRIES:
                    raise
                says(f"once more: {ended}")
        end(browser, server, url)


def poses(browser, url):
    browser.open(url, POSING)
    seen = browser.look_until(lambda seen: in_3d(seen) and "suggested" in seen["drawn"] and seen["match"] and seen["progress"],
                              "a figure in 3D, the pose to take, how well it is met, and progress")
    says(f"\"{seen['phaseText']}\", \"{seen['instruction']}\", {seen['triangles']} triangles")
    browser.shoot("worker-identifying")
    browser.open(url, HOLDS)
    browser.look_until(lambda seen: seen["hold"], "the ring")
    browser.shoot("worker-hold-still")


def learnt_and_loaded(browser, url):
    browser.open(f"{url}engineer")
    seen = browser.look_until(lambda seen: seen["parameters"] > 5 and seen["convergence"] > 5 and seen["residual"] > 5
                              and seen["latency"] > 3 and sensors_speak(seen) and "support" in seen["plate"],
                              "curves, parameters, latencies, sensors and the plate")
    says(f"engineer: {seen['parameters']} parameters, {seen['latency']} stages of latency, sensors {seen['sensors']}")
    browser.look_until(lambda seen: seen["phase"] == "monitoring" and "estimated" in seen["plate"], "who was learnt")
    browser.shoot_whole("engineer")
    browser.open(url)
    seen = browser.look_until(lambda seen: seen["worst"] and seen["joints"] and in_3d(seen) and seen["load"] not in ("–", "0.0 kg"),
                              "a load and the most loaded joint")
    says(f"\"{seen['phaseText']}\", \"{seen['instruction']}\", worst {seen['worst']}, load {seen['load']}")


def sensors_speak(seen):
    """Both sensors have an age of their newest sample in milliseconds, and an adapter that says how many come."""
    return len(seen["sensors"]) == 2 and all(" ms" in row[1] and " Hz" in row[3] for row in seen["sensors"])


def cpu_s(process):
    with open(f"/proc/{process.pid}/stat", encoding="ascii") as file:
        fields = file.read().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def station(browser, start, url, equipoise, config, suit, plate):
    server = start(equipoise, "view", "--config", config)
    wait_for(url, server)
    browser.ask("Page.navigate", url=url)
    browser.look_until(lambda seen: seen["connection"] == "silent" and nothing_shown(seen), "that the daemon is silent")
    daemon = start(equipoise, "run", "--config", config)
    browser.look_until(lambda seen: seen["phase"] in ("waiting", "degraded"), "a daemon that waits for its sensors")
    browser.shoot("worker-waiting")
    browser.open(f"{url}engineer")
    browser.look_until(lambda seen: seen["phase"] in ("waiting", "degraded") and len(seen["sensors"]) == 2
                       and all(row[1] == "–" for row in seen["sensors"]), "sensors without a sample")
    browser.shoot_whole("engineer-waiting")
    browser.open(url)
    person = start(equipoise, "simulate", "--suit", suit, "--plate", plate)
    learning(browser, server, url)
    browser.look_until(lambda seen: seen["phase"] == "monitoring", "who was learnt")
    silence(browser, url, person)
    if SHOTS:
        # One to three minutes on a busy machine: only who wants the picture waits for it.
        person = start(equipoise, "simulate", "--suit", suit, "--plate", plate, "--mass-kg", "73.2")
        unexplained(browser, url)
        person.kill()
    start(equipoise, "simulate", "--suit", suit, "--plate", plate, "--do", "lifts")
    levels(browser, url)
    daemon.kill()
    browser.open(f"{url}engineer")
    browser.look_until(lambda seen: seen["connection"] == "silent" and len(seen["sensors"]) == 2
                       and all(row[1] == "–" and "silent" in row[2] for row in seen["sensors"])
                       and seen["incidentsText"].startswith("Not known"), "that daemon and adapters are gone")
    browser.shoot("engineer-daemon-dead")
    browser.open(url)
    gone = browser.look_until(lambda seen: seen["connection"] == "silent" and nothing_shown(seen), "that the daemon is gone")
    browser.shoot("worker-daemon-dead")
    says(f"after the daemon was killed: \"{gone['instruction']}\", and no figure")
    if server.poll() is not None:
        raise RuntimeError(f"the page's process ended with {server.returncode} when the daemon was killed")
    end(browser, server, url)


def learning(browser, server, url):
    browser.look_until(lambda seen: in_3d(seen) and seen["phase"] == "identifying" and seen["match"], "a person to learn")
    says(f"three languages: {', '.join(languages(browser).values())}")
    browser.say_in("de")
    browser.look_until(lambda seen: seen["match"], "German")
    browser.shoot_whole("worker-identifying-de", UPRIGHT)
    browser.say_in("en")
    browser.shoot_whole("worker-phone", PHONE)
    begun = (cpu_s(server), time.monotonic())
    time.sleep(5)
    share = (cpu_s(server) - begun[0]) / (time.monotonic() - begun[1])
    says(f"one worker's page at 60 Hz costs its server {100 * share:.1f} % of a core")
    without_webgl(url)
    commands(browser, url)


def silence(browser, url, person):
    browser.open(f"{url}engineer")
    browser.look_until(sensors_speak, "sensors that speak")
    person.kill()
    browser.look_until(lambda seen: "suit_silent" in seen["incidents"], "the incident")
    seen = browser.look_until(lambda seen: not sensors_speak(seen), "that their newest samples are old")
    browser.shoot_whole("engineer-suit-lost")
    says(f"suit lost: sensors {seen['sensors']}")
    browser.open(url)
    seen = browser.look_until(lambda seen: "suit_stale" in seen["reasons"] and "worker" not in seen["drawn"], "that the suit is lost")
    browser.shoot("worker-suit-lost")
    says(f"suit lost: \"{seen['instruction']}\"")


def unexplained(browser, url):
    """Who comes back with a coat of 1.2 kg on is not who was learnt, and carries too little to call it a load."""
    browser.open(f"{url}engineer")
    seen = browser.look_until(lambda seen: seen["model"] and sensors_speak(seen), "that the model does not explain this worker", 2 * LOOK_S)
    browser.shoot_whole("engineer-model")
    says(f"engineer: \"{seen['model']}\"")


def levels(browser, url):
    """Boxes that are easy to hold near, a medium load held out, high, and too heavy for that."""
    # What is heavy is not always known well enough to be judged: only who wants the pictures waits for it.
    for level in ("green", "orange", "red", "above_max") if SHOTS else ("green", "orange"):
        browser.open(url, LEVEL.format(level))
        seen = browser.look_until(lambda seen: seen["level"] == level and in_3d(seen), f"a joint whose level is {level}")
        says(f"\"{seen['instruction']}\", {seen['worst']} {level}, load {seen['load']}")
        browser.shoot(f"worker-{level.replace('_', '-')}")
        if level == "orange":
            says(f"three languages: {', '.join(languages(browser).values())}")
            browser.say_in("it")
            browser.shoot("worker-orange-it")
            browser.say_in("en")
        if level == "above_max":
            browser.shoot_whole("worker-phone-above-max", PHONE)
    loaded(browser, url)


def loaded(browser, url):
    browser.open(f"{url}engineer")
    browser.look_until(lambda seen: not seen["reasons"] and seen["apart"] > 60.0 and seen["residual"] > 50,
                       "what a load does to the centre of pressure")
    browser.shoot_whole("engineer-load")


def without_webgl(url):
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        plain = Browser(profile, "--disable-3d-apis")
        try:
            plain.size(TABLET)
            plain.ask("Page.navigate", url=url)
            plain.look_until(lambda seen: is_live(seen) and seen["figure"] == "2d" and seen["flat"], "a flat figure, and that it is one")
            plain.shoot("worker-flat")
            says("without WebGL the figure is flat, and the page says so")
        finally:
            plain.close()


def press(browser, name):
    """As soon as the buttons take a click again; and twice, as an impatient hand does."""
    browser.look_until(lambda seen: seen["busy"] == 0, "buttons that take a click")
    browser.run(f"document.querySelector('[data-command={name}]').focus()")
    for _ in range(2):
        browser.click(f"[data-command={name}]")
    if browser.run("document.activeElement.dataset.command") != name:
        raise RuntimeError(f"who pressed {name} by a key has lost the place on the page")


def commands(browser, url):
    """Buttons do nothing without the token, are refused with a wrong one, and command with the right one, once."""
    browser.ask("Page.navigate", url=f"{url}engineer")
    browser.look_until(lambda seen: seen["parameters"] > 5 and seen["convergence"] > 5 and sensors_speak(seen), "curves of who is learnt")
    browser.shoot_whole("engineer-identifying")
    browser.look_until(lambda seen: seen["disabled"] == 6 and seen["connection"] == "live", "buttons that wait for the token")
    browser.type("token", "w" * 32)
    press(browser, "identify-stop")
    browser.look_until(lambda seen: seen["reply"] == "refused: This needs the command token.", "that the token is wrong")
    browser.type("token", SECRET)
    press(browser, "tare")
    browser.look_until(lambda seen: seen["reply"].startswith("refused: ") and "refused: refused" in seen["reply"],
                       "that a plate with a person on it is not tared")
    press(browser, "identify-stop")
    seen = browser.look_until(lambda seen: seen["reply"].startswith("done: stopped"), "the end of learning")
    says(f"engineer: stop says \"{seen['reply']}\"")
    browser.run("document.querySelector('.commands').scrollIntoView()")
    browser.shoot("engineer-commands")
    press(browser, "identify-start")
    # Until the page has heard of it, the phase is that of who was learnt.
    browser.look_until(lambda seen: seen["reply"].startswith("done: held poses") and seen["phase"] == "identifying",
                       "that learning goes on")


def main():
    kind, url, *arguments = sys.argv[1:]
    started = []

    def start(*command):
        started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL))
        return started[-1]

    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        browser, begun = None, time.monotonic()
        try:
            browser = Browser(profile, "--lang=en-US")
            browser.size(TABLET)
            {"demo": demo, "station": station}[kind](browser, start, url, *arguments)
            if browser.errors:
                raise RuntimeError(f"errors in the page's scripts: {browser.errors}")
            says(f"{kind}: {time.monotonic() - begun:.0f} s")
        except (RuntimeError, OSError) as error:
            if browser and SHOTS:
                browser.keep("failed")
            sys.exit(f"page: {error}")
        finally:
            if browser:
                browser.close()
            for process in started:
                if process.poll() is None:
                    process.kill()
                process.wait()


if __name__ == "__main__":
    main()
