"""Client of .ci/rtde: a client that is not ours on the controller, and what the controller prints of its registers."""

import pathlib
import re
import sys
import textwrap
import time

PATIENCE_S = 60
SEQUENCE, STATE, AGE = "input_int_register_24", "input_int_register_25", "input_double_register_24"


def last(path):
    """The newest whole line of the controller, as numbers."""
    lines = pathlib.Path(path).read_text().split("\n")[:-1]
    reports = [line for line in lines if line.startswith("packages=")]
    return {name: float(value) for name, value in (word.split("=") for word in reports[-1].split())} if reports else {}


def until(what, ready):
    begun = time.monotonic()
    while True:
        value = ready()
        if value:
            return value
        if time.monotonic() - begun > PATIENCE_S:
            sys.exit(f"rtde: waited in vain until {what}")
        time.sleep(0.05)


def other_client(robot, path):
    """ur_rtde sets registers of its own; the controller must have understood."""
    import rtde_io

    client = until("ur_rtde connects", lambda: attempt(lambda: rtde_io.RTDEIOInterface(robot, False, True)))
    assert client.setInputIntRegister(42, 4711) and client.setInputDoubleRegister(43, 0.125) and client.setSpeedSlider(0.5)
    values = {"input_int_register_42": 4711, "input_double_register_43": 0.125, "speed_slider_fraction": 0.5}
    until("the controller has ur_rtde's values",
          lambda: all(last(path).get(name) == value for name, value in values.items()))
    time.sleep(4)
    client.disconnect()
    print("rtde: ur_rtde spoke to the controller, and left")


def attempt(what):
    try:
        return what()
    except RuntimeError:
        return None


def moving(path):
    """Two lines, the sequence of the second being later."""
    first = until("a sequence is written", lambda: SEQUENCE in last(path) and last(path))
    return first, until("the sequence moves", lambda: last(path)[SEQUENCE] > first[SEQUENCE] and last(path))


def stands(path):
    before = last(path)
    time.sleep(0.5)
    return last(path) == before


class Robot:
    """The parts of a robot's program that look at registers, as Python: URScript differs in few words."""

    STEP_S = 0.002

    def __init__(self, path, registers):
        self.registers = registers
        self.world = {
            "read_input_integer_register": lambda number: registers["int", number],
            "read_input_float_register": lambda number: registers["double", number],
            "get_steptime": lambda: self.STEP_S,
            "floor": lambda number: int(number // 1),
        }
        lines = [line for line in textwrap.dedent(pathlib.Path(path).read_text()).split("\n") if line.strip() != "end"]
        body = textwrap.dedent("\n".join(lines[lines.index("def equipoise_example():") + 1:]))
        settings, body = re.split(r"(?=^thread )", body, maxsplit=1, flags=re.MULTILINE)
        functions = re.split(r"^rtde_set_watchdog", body, flags=re.MULTILINE)[0]
        functions = functions.replace("thread ", "def ").replace("sync()", "yield").replace("local ", "")
        names = ", ".join(re.findall(r"^(equipoise_\w+) =", settings, flags=re.MULTILINE))
        functions = re.sub(r"^(def .*:)$", rf"\1\n  global {names}", functions, flags=re.MULTILINE)
        exec(settings + functions, self.world)  # pylint: disable=exec-used
        self.watch = self.world["equipoise_watch"]()

    def after(self, seconds, sequence=None):
        """Speed fraction after a time in which the sequence stands, moves at 100 Hz (`moves`) or in each step (`bursts`)."""
        for step in range(round(seconds / self.STEP_S)):
            if sequence == "moves" and step % 5 == 0:
                self.registers["int", 24] += 1
            elif sequence == "bursts":
                self.registers["int", 24] += 1
            next(self.watch)
        return self.world["equipoise_share"]()


def script(path):
    """Old values, standstills and bursts are not accepted; a station that keeps publishing is."""
    green = {("int", 24): 5000, ("int", 25): 1, ("int", 26): 0, ("int", 27): 256, ("int", 28): 1, ("double", 24): 0.004}
    robot = Robot(path, dict(green))
    assert robot.after(0.002) == 0 and robot.after(5) == 0, "a value from before the start is accepted"
    assert robot.after(0.3, "moves") == 0, "a burst after a standstill is accepted"
    assert robot.after(1, "moves") == 1, "a station that publishes is not accepted"
    assert robot.after(0.05) == 1, "a single package that is late stops the robot"
    assert robot.after(0.1) == 0, "a station that is silent is accepted"
    assert robot.after(0.1, "bursts") == 0, "packages that waited in the network are accepted"
    assert robot.after(0.5, "moves") == 1
    for change, speed_factor in [(("int", 28, 2), 0.6), (("int", 28, 3), 0.25), (("int", 28, 5), 0.25), (("int", 27, 255), 0.25),
                          (("int", 25, 2), 0), (("double", 24, -1.0), 0), (("double", 24, 0.2), 0)]:
        robot.registers.update(green)
        kind, number, value = change
        robot.registers[kind, number] = value
        assert robot.after(1, "moves") == speed_factor, f"{change}: {robot.after(0.01, 'moves')}, not {speed_factor}"
    robot.registers.update(green)
    robot.registers.update({("int", 26): 32, ("int", 27): 0, ("int", 28): 0})
    assert robot.after(1, "moves") == 1, "nothing in the hands is knowledge"
    print("rtde: the robot's program accepts no values that stand, begin, stop or burst")


def main():
    what, path, *rest = sys.argv[1:]
    if what == "script":
        script(path)
    elif what == "other-client":
        other_client(path, rest[0])
    elif what == "wait":
        until(f"{rest[0]} is written", lambda: rest[0] in last(path))
    elif what == "refused":
        needle = f"{rest[0]} is written by another client"
        until("the gateway is refused", lambda: needle in pathlib.Path(path).read_text())
        print(f"rtde: refused while ur_rtde was there: {needle}")
    elif what == "written":
        until("a current state is written", lambda: last(path).get(STATE) == 1)
        first, second = moving(path)
        assert 0 <= second[AGE] <= 0.025, f"a state of {second[AGE]} s"
        assert second["input_int_register_42"] != 4711, "the register is not ours"
        print(f"rtde: packages {first['packages']:.0f} to {second['packages']:.0f}, age {1e3 * second[AGE]:.1f} ms")
    elif what == "silent":
        until("the state is silent", lambda: last(path)[STATE] == 2)
        _, second = moving(path)
        assert second[STATE] == 2 and second[AGE] == -1 and second["input_int_register_26"] == -1, second
        print("rtde: without a daemon: silent, and the sequence moves")
    elif what == "still":
        # What it sent last may be read a moment after it has gone.
        until("no process writes any more", lambda: stands(path))
        assert last(path)[STATE] == 2, last(path)
        print("rtde: without the gateway the sequence stands still")


if __name__ == "__main__":
    main()
