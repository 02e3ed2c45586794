"""Opens the pages in headless Chromium, operates them in every phase and checks what they show (browser.py).

page.py demo URL DEMO-COMMAND...          the demonstration: poses, a load, the service's death, the end
page.py station URL EQUIPOISE CONFIG SUIT PLATE   a page next to daemon and person: every level, commands, silence, no WebGL
"""

import json
import os
import pathlib
import socket
import subprocess
import sys
import tempfile
import time
import urllib.request

from browser import LANGUAGES, LOOK_S, SHOTS, Browser, Ended

SECRET = "of-the-test-0123456789abcdefghij"
START_S = 60.0
TRIES = 4
# The demonstration lifts them, in turn; longer than the page waits for a lost server.
BOXES = ["box of 4\u00a0kg", "box of 10\u00a0kg", "box of 16\u00a0kg"]
RECONNECTED_S = 8.0

# Conditions on the newest frame, at which the page is frozen.
POSING = """(last) => {
  const frame = last && JSON.parse(last);
  return frame?.phase_name === 'identifying' && frame.suggested && frame.segment_origin_m
    && frame.state.cop_measured && !frame.state.static_pose && frame.state.pose_mismatch_rad > frame.pose_reached_rad;
}"""
HOLDS = POSING.replace(" > ", " < ")
LOADED = """(last) => last && JSON.parse(last).worst && Number(document.getElementById('residual').dataset.points) > 50"""
LEVEL = "(last) => last && JSON.parse(last).worst?.level === '{}'"

# Alterations of frames and facts, for what the simulation does not have (browser.py).
MISMATCH = "the model no longer explains this worker's data: while the worker moves, the vertical force lies in the median 12 N above " \
    "what is predicted (6.1 σ)"
UNEXPLAINED = f"{{ station: (facts) => {{ if (facts.daemon) facts.daemon.model_mismatch = {json.dumps(MISMATCH)}; return facts; }} }}"
# A plate without shear, two plates, and values that no message has.
WITHOUT_SHEAR = """{ frame: (frame) => {
  frame.state.unavailable = ["shear"];
  frame.state.mass_kg = null;
  frame.state.lifts = "NaN";
  delete frame.state.ground_force_n;
  delete frame.plate_corners_m;
  return frame;
} }"""
LONG_NAMES = """{ station: (facts) => {
  facts.station = "s".repeat(64);
  if (facts.daemon) facts.daemon.subject = "w".repeat(64);
  facts.incidents = [{ name: "later_version", active: true, count: 1, duration_s: 1e6, message: "m".repeat(300) }, ...facts.incidents ?? []];
  return facts;
} }"""
MISSING = "—"


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


def report(text):
    print(f"page: {text}", flush=True)


def nothing_shown(seen):
    return not seen["phase"] and not seen["drawn"]


def is_live(seen):
    return seen["connection"] == "live" and seen["phase"] and seen["phaseText"] and "worker" in seen["drawn"]


def in_3d(seen):
    return is_live(seen) and seen["figure"] == "3d" and seen["triangles"] > 1000


def languages(browser):
    """Every text changes with the language."""
    links = {}
    for language in LANGUAGES:
        seen = browser.select_language(language)
        table = json.loads(pathlib.Path(f"view/src/words/{language}.json").read_text(encoding="utf-8"))
        wrong = {key: text for key, text in seen["words"].items() if text != table[key]}
        if wrong or not seen["words"]:
            raise RuntimeError(f"differs from the table of {language}: {wrong or 'no texts'}")
        links[language] = seen["link"]
    if len(set(links.values())) != 3:
        raise RuntimeError(f"the same words in three languages: {links}")
    return links


def end(browser, server, url):
    browser.server = None
    server.kill()
    server.wait()
    gone = browser.look_until(lambda seen: seen["connection"] in ("lost", "silent") and nothing_shown(seen), "that the service is gone")
    report(f"after the service at {url} was killed: \"{gone['instruction']}\", and no figure")


def demo(browser, start, url, *command):
    """Each scene from the start; repeated if the browser was too late on a slow machine, because the simulation does not wait."""
    for scene, finish in ((poses, end), (loaded_after_identification, keeps_results)):
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
                report(f"repeated: {ended}")
        finish(browser, server, url)


def keeps_results(browser, server, url):
    """The demonstration ends by itself; its page keeps the results, and does not look for a server."""
    browser.server = None
    seen = browser.look_until(lambda seen: seen["connection"] == "ended" and seen["results"], "the last results")
    if code := server.wait(30):
        raise RuntimeError(f"the demonstration at {url} ended with {code}")
    time.sleep(RECONNECTED_S)
    if (later := browser.look()) != seen or any(row[1] not in BOXES or "±" not in row[2] for row in seen["results"]):
        raise RuntimeError(f"not the results: {seen}, later {later}")
    report(f"\"{seen['instruction']}\": {'; '.join(' '.join(row[1:]) for row in seen['results'])}")
    browser.shoot("worker-ended")
    languages(browser)


def poses(browser, url):
    browser.open(url, POSING)
    seen = browser.look_until(lambda seen: in_3d(seen) and "suggested" in seen["drawn"] and seen["match"] and seen["progress"],
                              "a figure in 3D, the pose to take, how well it is met, and progress")
    report(f"\"{seen['phaseText']}\", \"{seen['instruction']}\", {seen['triangles']} triangles")
    browser.open(url, HOLDS)
    # The person of the demonstration takes the suggested poses; that of `simulate` takes its own.
    browser.look_until(lambda seen: seen["frozen"] and seen["hold"], "the ring")
    browser.shoot("worker-hold-still")


def loaded_after_identification(browser, url):
    browser.open(f"{url}engineer")
    seen = browser.look_until(lambda seen: seen["parameters"] > 5 and seen["convergence"] > 5 and seen["residual"] > 5
                              and seen["latency"] > 3 and sensors_active(seen) and "support" in seen["plate"],
                              "curves, parameters, latencies, sensors and the plate")
    report(f"engineer: {seen['parameters']} parameters, {seen['latency']} stages of latency, sensors {seen['sensors']}")
    browser.look_until(lambda seen: seen["phase"] == "monitoring" and "estimated" in seen["plate"], "an identified worker")
    browser.open(url)
    seen = browser.look_until(lambda seen: seen["level"] and seen["loaded"] and seen["fatigue"] and in_3d(seen) and "load" in seen["drawn"],
                              "a load and the level of the most loaded joint")
    report(f"\"{seen['phaseText']}\", \"{seen['instruction']}\", load {seen['load']}, drawn: {seen['drawn']}")


def sensors_active(seen):
    """Both sensors have an age of their newest sample in milliseconds, and an adapter with a rate."""
    return len(seen["sensors"]) == 2 and all(" ms" in row[1] and " Hz" in row[3] for row in seen["sensors"])


def nothing_valid(seen):
    """No torque, no load and no force; each with the reason."""
    measured = [seen["quantities"].get(name) for name in ("load", "reach", "external_force", "vertical_force", "l5s1_moment", "l5s1_compression")]
    return seen["joints"] and all(text == MISSING for text in seen["joints"]) and seen["jointsWhy"] and all(one and one[0] == MISSING and one[1] for one in measured)


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
                       and all(row[1] == MISSING for row in seen["sensors"]) and nothing_valid(seen), "sensors without a sample")
    browser.shoot("engineer-waiting")
    browser.open(url)
    person = start(equipoise, "simulate", "--suit", suit, "--plate", plate)
    identification(browser, server, url)
    browser.look_until(lambda seen: seen["phase"] == "monitoring", "an identified worker")
    silence(browser, url, person)
    start(equipoise, "simulate", "--suit", suit, "--plate", plate, "--do", "lifts")
    levels(browser, url)
    stations(browser, start, url, equipoise)
    daemon.kill()
    browser.look_until(lambda seen: seen["tiles"] and seen["tiles"][0]["connection"] == "silent", "that the daemon of a station is gone")
    browser.open(f"{url}engineer")
    browser.look_until(lambda seen: seen["connection"] == "silent" and len(seen["sensors"]) == 2
                       and all(row[1] == MISSING and "silent" in row[2] for row in seen["sensors"]) and nothing_valid(seen)
                       and seen["incidentsText"].startswith("Not known"), "that daemon and adapters are gone")
    browser.shoot("engineer-daemon-dead")
    browser.open(url)
    gone = browser.look_until(lambda seen: seen["connection"] == "silent" and nothing_shown(seen), "that the daemon is gone")
    browser.shoot("worker-daemon-dead")
    report(f"after the daemon was killed: \"{gone['instruction']}\", and no figure")
    if server.poll() is not None:
        raise RuntimeError(f"the page's process ended with {server.returncode} when the daemon was killed")
    end(browser, server, url)


def identification(browser, server, url):
    browser.look_until(lambda seen: in_3d(seen) and seen["phase"] == "identifying" and seen["match"], "a worker to identify")
    report(f"three languages: {', '.join(languages(browser).values())}")
    begun = (cpu_s(server), time.monotonic())
    time.sleep(5)
    core_fraction = (cpu_s(server) - begun[0]) / (time.monotonic() - begun[1])
    report(f"one worker's page at 60 Hz costs its server {100 * core_fraction:.1f} % of a core")
    for name, language in (("worker-identifying", "en"), ("worker-identifying-de", "de")):
        restart_identification(url)
        browser.open(url, POSING)
        browser.look_until(lambda seen: seen["frozen"] and seen["match"], name)
        browser.select_language(language)
        browser.shoot(name)
        browser.select_language("en")
    restart_identification(url)
    without_webgl(url)
    commands(browser, url)


def restart_identification(url):
    """Pictures take longer than the simulated worker takes to be identified."""
    request = urllib.request.Request(f"{url}api/command/identify-reset", method="POST", headers={"X-Equipoise-Command": SECRET})
    urllib.request.urlopen(request, timeout=30).read()


def silence(browser, url, person):
    browser.open(f"{url}engineer")
    browser.look_until(sensors_active, "active sensors")
    person.kill()
    browser.look_until(lambda seen: "suit_silent" in seen["incidents"], "the incident")
    seen = browser.look_until(lambda seen: not sensors_active(seen), "that their newest samples are old")
    browser.shoot("engineer-suit-lost")
    report(f"suit lost: sensors {seen['sensors']}")
    browser.open(url)
    seen = browser.look_until(lambda seen: "suit_stale" in seen["reasons"] and "worker" not in seen["drawn"], "that the suit is lost")
    browser.shoot("worker-suit-lost")
    report(f"suit lost: \"{seen['instruction']}\"")


def stations(browser, start, url, equipoise):
    """Several stations on one page: this one, and one that does not answer."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        listen = "127.0.0.1:%d" % free.getsockname()[1]
    with tempfile.TemporaryDirectory() as folder:
        file = pathlib.Path(folder, "stations.toml")
        file.write_text(f'[page]\nlisten = "{listen}"\n[[station]]\nurl = "{url}"\n[[station]]\nurl = "http://127.0.0.1:1/"\n', encoding="utf-8")
        server = start(equipoise, "view", "--stations", str(file))
        wait_for(f"http://{listen}/", server)
    browser.open(f"http://{listen}/")
    # A missed deadline of a busy machine also needs attention, so that the order varies.
    seen = browser.look_until(lambda seen: {one["connection"]: one["level"] != "none" for one in seen["tiles"]} ==
                              {"lost": False, "live": True}, "a lost station, and a live one with a load")
    report(f"stations: \"{seen['link']}\", {[one['text'] for one in seen['tiles']]}")
    report(f"stations, three languages: {', '.join(languages(browser).values())}")
    browser.shoot("stations")


def levels(browser, url):
    """Boxes that are easy to hold near, a medium load held out, high, and too heavy for that."""
    # Heavy loads are often undecided, so their levels are awaited only for the pictures.
    for level in ("green", "orange", "red", "above_max") if SHOTS else ("green", "orange"):
        browser.open(url, LEVEL.format(level))
        seen = browser.look_until(lambda seen: seen["frozen"] and seen["level"] == level and in_3d(seen), f"a joint whose level is {level}")
        report(f"\"{seen['instruction']}\", load {seen['load']}, \"{seen['advice']}\"")
        if level not in ("orange", "red") and seen["advice"]:
            raise RuntimeError(f"advice at level {level}: {seen['advice']}")
        browser.shoot(f"worker-{level.replace('_', '-')}")
        if level == "orange":
            report(f"three languages: {', '.join(languages(browser).values())}")
            browser.select_language("it")
            browser.shoot("worker-orange-it")
            browser.select_language("en")
    if SHOTS:
        browser.open(url)
        browser.look_until(in_3d, "a figure")
        browser.film("worker", 15.0, 0.2)
    loaded(browser, url)


def loaded(browser, url):
    browser.open(f"{url}engineer", LOADED)
    seen = browser.look_until(lambda seen: seen["frozen"] and "±" in seen["joints"][0] and "±" in seen["quantities"]["load"][0]
                              and sensors_active(seen), "torques with their σ, and a load")
    report(f"engineer: lower back {seen['joints'][0]} N m, load {seen['quantities']['load'][0]}")
    browser.shoot("engineer-load")
    for tab in ("latency", "sensors"):
        browser.click(f"[data-tab={tab}]")
        browser.look_until(lambda seen: seen["tab"] == tab and seen["latency"] > 3, f"the tab {tab}")
        browser.shoot(f"engineer-{tab}")
    altered(browser, url)


def altered(browser, url):
    """What the simulation does not have: the daemon's monitor needs 40 s without any gap, which a busy machine may never provide."""
    browser.open(f"{url}engineer", alter=UNEXPLAINED)
    seen = browser.look_until(lambda seen: seen["model"] and sensors_active(seen), "that the model does not explain this worker")
    browser.shoot("engineer-model")
    report(f"engineer: \"{seen['model']}\"")
    browser.open(f"{url}engineer", alter=WITHOUT_SHEAR)
    seen = browser.look_until(lambda seen: "N" in seen["quantities"].get("vertical_force", [""])[0] and seen["connection"] == "live", "the vertical force")
    wrong = {name: seen["quantities"][name] for name in ("shear", "mass", "lifts") if seen["quantities"][name][0] != MISSING or not seen["quantities"][name][1]}
    if wrong or "measured" not in seen["quantities"]["shear"][1]:
        raise RuntimeError(f"values that are not valid: {seen['quantities']}")
    browser.shoot("engineer-without-shear")
    browser.open(f"{url}engineer", alter=LONG_NAMES)
    browser.look_until(lambda seen: "later_version" in seen["incidents"] and seen["connection"] == "live", "long names")
    browser.shoot("engineer-long-names")


def without_webgl(url):
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as profile:
        plain = Browser(profile, "--disable-3d-apis")
        try:
            plain.ask("Page.navigate", url=url)
            plain.look_until(lambda seen: is_live(seen) and seen["figure"] == "2d" and seen["flat"], "a 2D figure, and a note about it")
            plain.shoot("worker-flat")
            report("without WebGL the figure is 2D, with a note")
        finally:
            plain.close()


def press(browser, name):
    """Clicks twice as soon as the buttons are active."""
    browser.look_until(lambda seen: seen["busy"] == 0, "buttons that take a click")
    browser.run(f"document.querySelector('[data-command={name}]').focus()")
    for _ in range(2):
        browser.click(f"[data-command={name}]")
    if browser.run("document.activeElement.dataset.command") != name:
        raise RuntimeError(f"{name} lost the keyboard focus")


def commands(browser, url):
    """Buttons are inactive without the token and with a wrong one, and send one command with the right one."""
    browser.open(f"{url}engineer")
    browser.look_until(lambda seen: seen["parameters"] > 5 and seen["convergence"] > 5 and sensors_active(seen), "curves during identification")
    report(f"engineer, three languages: {', '.join(languages(browser).values())}")
    # An explanation by keyboard focus.
    browser.run("document.querySelector('.term').focus()")
    browser.shoot("engineer-identifying")
    restart_identification(url)
    browser.click("[data-tab=commands]")
    browser.look_until(lambda seen: seen["disabled"] == 6 and seen["connection"] == "live", "inactive buttons")
    browser.type("token", "w" * 32)
    browser.look_until(lambda seen: seen["token"] == "refused: The command token is wrong." and seen["disabled"] == 6, "that the token is wrong")
    browser.shoot("engineer-wrong-token")
    browser.type("token", SECRET)
    browser.look_until(lambda seen: seen["token"].startswith("done: ") and seen["disabled"] < 6, "that the token is accepted")
    press(browser, "tare")
    browser.look_until(lambda seen: seen["reply"].startswith("refused: ") and "refused: refused" in seen["reply"],
                       "that a plate with a person on it is not tared")
    press(browser, "identify-stop")
    seen = browser.look_until(lambda seen: seen["reply"].startswith("done: stopped"), "the end of identification")
    report(f"engineer: reply to stop \"{seen['reply']}\"")
    browser.type("token", SECRET)
    browser.look_until(lambda seen: seen["workers"] == ["anon-1"], "the stored worker")
    browser.shoot("engineer-commands")
    press(browser, "identify-start")
    # Until the next frame, the phase is the previous one.
    browser.look_until(lambda seen: seen["reply"].startswith("done: held poses") and seen["phase"] == "identifying",
                       "that identification continues")


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
            {"demo": demo, "station": station}[kind](browser, start, url, *arguments)
            if browser.errors:
                raise RuntimeError(f"errors in the page's scripts: {browser.errors}")
            report(f"{kind}: {time.monotonic() - begun:.0f} s")
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
