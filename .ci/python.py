"""The Python package on a recording, and its notebooks: python.py FOLDER, which has session.mcap."""

import base64
import glob
import os
import subprocess
import sys
import warnings

import matplotlib
import nbformat
import numpy
import pandas
from mcap.reader import make_reader
from mcap_ros1.decoder import DecoderFactory
from nbclient import NotebookClient
from traitlets.config import Config

import equipoise
from equipoise import Joint, ProgramError, _arrays

RECORDING = "session.mcap"
NOTEBOOKS = os.path.abspath("clients/python/notebooks")
# Compared value by value: the end, in which a load was lifted, s.
LAST_S = 10
IMAGE_BYTES_MIN = 10_000


def floats(column):
    return column.to_numpy(dtype=float, na_value=numpy.nan)


def check_csv(span):
    """The program's own CSV has the same values, and an empty cell where one is missing."""
    rows = {}
    for topic in ("state", "suit", "ground", "cycle"):
        frame = equipoise.read_recording(RECORDING, topic, span=span)
        command = [os.environ["EQUIPOISE_PROGRAM"], "export", RECORDING, "--out", "table.csv", "--topic", topic]
        subprocess.run([*command, "--span", f"{span[0]}:{span[1]}"], check=True, stdout=subprocess.DEVNULL)
        csv = pandas.read_csv("table.csv", float_precision="round_trip", low_memory=False).set_index("t_s")
        assert list(frame.columns) == list(csv.columns) and frame.index.equals(csv.index), topic
        for name in frame:
            if name.endswith("_name") or name.endswith("_names"):
                assert (frame[name] == csv[name].fillna("")).all(), f"{topic}.{name}"
            else:
                assert numpy.array_equal(floats(frame[name]), floats(csv[name]), equal_nan=True), f"{topic}.{name}"
        assert len(frame) > 100 and frame.attrs["units"], topic
        rows[topic] = len(frame)
    parts = list(equipoise.iter_recording(RECORDING, "ground", rows=1000, span=span))
    whole = equipoise.read_recording(RECORDING, "ground", span=span)
    assert max(map(len, parts)) == 1000 and pandas.concat(parts).equals(whole), "chunks"
    return ", ".join(f"{topic} {count}" for topic, count in rows.items())


def check_validity(states):
    """By the package's own rules: a flag leaves no value, and torques without a flag are there."""
    raised = states["valid"].to_numpy(dtype="uint64")
    withheld = 0
    for field, flags in _arrays.INVALIDATED_BY.items():
        values = equipoise.to_numpy(states, field)
        invalid = raised & int(flags) != 0
        assert numpy.isnan(values[invalid]).all(), f"{field}: a value that is invalid"
        withheld += int(invalid.sum())
    torques = equipoise.to_numpy(states, "torque_nm")
    assert torques.shape == (len(states), equipoise.JOINTS, 3)
    assert numpy.isfinite(torques[raised == 0]).all() and (raised == 0).sum() > 1000, "a valid torque is missing"
    assert withheld > 1000, "nothing was invalid"
    names = states["valid_names"].str.replace(" ", ", ").replace("", "none")
    assert (names == [str(equipoise.Reason(int(flags))) for flags in raised]).all(), "names of flags"


def check_bytes(states):
    """The recorded messages, decoded by the mcap package."""
    by_cycle = states.set_index("cycle")
    torque_nm = equipoise.to_numpy(by_cycle, "torque_nm", Joint.RIGHT_KNEE)
    place = {int(cycle): at for at, cycle in enumerate(by_cycle.index)}
    compared = 0
    with open(RECORDING, "rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        begin_ns = reader.get_summary().statistics.message_end_time - int(1e9 * LAST_S)
        for _, _, _, state in reader.iter_decoded_messages(["/equipoise/state"], starting_at=begin_ns):
            published = state.torque_nm[3 * Joint.RIGHT_KNEE:][:3] if state.valid == 0 else [numpy.nan] * 3
            assert numpy.array_equal(torque_nm[place[state.cycle]], published, equal_nan=True), f"cycle {state.cycle}"
            compared += state.valid == 0
    assert compared > 100, f"only {compared} states with torques"
    return compared


def refused(kind, words, call, *arguments, **options):
    try:
        call(*arguments, **options)
    except kind as error:
        assert words in str(error), f"{error}: lacks {words!r}"
    else:
        raise AssertionError(f"not refused: {words}")


def check_errors(states):
    with open("text.mcap", "w", encoding="utf-8") as file:
        file.write("no recording\n")
    refused(ProgramError, "not a recording", equipoise.read_recording, "text.mcap")
    refused(ProgramError, "nothing.mcap", equipoise.read_recording, "nothing.mcap")
    refused(ProgramError, "nothing.mcap", equipoise.replay, "nothing.mcap")
    refused(ProgramError, "'gone' not found: install", equipoise.reconcile, RECORDING, program="gone")
    refused(ValueError, "nearest: RightKnee", equipoise.to_numpy, states, "torque_nm", "RigthKnee")
    refused(ValueError, "nearest: LeftKnee, RightKnee", equipoise.plot.torque, states, "knee")
    refused(ValueError, "nearest: torque_nm", equipoise.read_recording, RECORDING, columns=["torqe_nm"], span=(0, 1))
    refused(ProgramError, "possible values", equipoise.read_recording, RECORDING, "stats")
    for module, extra, call in (
        ("pyarrow", "recordings", "read_recording('x.mcap')"),
        ("matplotlib", "plot", "plot.gap({'gap': {'per_axis': {}}})"),
    ):
        program = f"import sys; sys.modules['{module}'] = None; import equipoise; equipoise.{call}"
        done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
        assert f"pip install 'equipoise[{extra}]'" in done.stderr, done.stderr


def check_readings():
    invalid = equipoise.Reading(equipoise.State(cycle=7, valid=12), 1, 900_000, None, 0, False, True)
    assert str(invalid.reasons) == f"{invalid.reasons}" == "not_identified, moving", invalid.reasons
    assert repr(invalid) == "<Reading: cycle 7, waiting, 0.9 ms old; no torques: not_identified, moving>", repr(invalid)
    assert invalid.reason_names == ["not_identified", "moving"] and invalid.reasons == 12
    state = equipoise.State(cycle=7, phase=2, worst_joint=int(Joint.LEFT_KNEE))
    state.torque_nm[3 * Joint.LEFT_KNEE + 1] = -5.0
    valid = equipoise.Reading(state, 1, 0, None, 0, False, True)
    assert "LeftKnee 5.0 ± 0.0 N m of 0, none" in repr(valid) and str(valid.reasons) == "none", repr(valid)
    assert valid.torque_nm("left knee") == valid.torque_nm(Joint.LEFT_KNEE) == (0.0, -5.0, 0.0)
    refused(ValueError, "nearest: LeftKnee", valid.torque_nm, "LeftNee")


def check_plots(states, finding):
    torque = equipoise.plot.torque(states, "L5S1")
    drawn = torque.lines[0].get_ydata()
    assert numpy.isfinite(drawn).sum() > 1000 and numpy.isnan(drawn).any(), "no torque, or no gap"
    assert "below_load_threshold" in [text.get_text() for text in torque.texts], "no reason of the gap"
    for figure in (torque.figure, equipoise.plot.cop(states), equipoise.plot.gap(finding)):
        figure.canvas.draw()
        pixels = numpy.asarray(figure.canvas.buffer_rgba())[..., :3]
        assert (pixels != 255).any(axis=2).mean() > 0.02, "an empty plot"


def run_notebook(path):
    """Executes a notebook, which must be stored without outputs; its text, and how many images it has."""
    notebook = nbformat.read(path, 4)
    code = [cell for cell in notebook.cells if cell.cell_type == "code"]
    assert not any(cell.outputs or cell.execution_count for cell in code), f"{path}: clear its outputs"
    # By sockets in the file system: other users of the machine may connect to TCP.
    NotebookClient(notebook, timeout=300, config=Config({"KernelManager": {"transport": "ipc"}})).execute()
    outputs = [output for cell in code for output in cell.outputs]
    images = [output.data["image/png"] for output in outputs if "image/png" in output.get("data", {})]
    assert len(images) >= 2 and all(len(base64.b64decode(one)) > IMAGE_BYTES_MIN for one in images), f"{path}: empty plots"
    return "".join(output.text for output in outputs if output.output_type == "stream" and output.name == "stdout")


def main():
    os.chdir(sys.argv[1])
    matplotlib.use("agg")  # Not by MPLBACKEND: notebooks would then have no images.
    warnings.simplefilter("ignore")  # That the recorder lost messages on a busy machine is no error here.
    assert not equipoise.__file__.startswith(os.path.dirname(NOTEBOOKS)), "the source, not the wheel"
    states = equipoise.read_recording(RECORDING)
    end_s = float(states.index[-1])
    rows = check_csv((end_s - LAST_S, end_s))
    check_validity(states)
    compared = check_bytes(states)
    check_errors(states)
    check_readings()
    summary = equipoise.replay(RECORDING, out="replayed.mcap")
    replayed = equipoise.read_recording("replayed.mcap", columns=["cycle"])
    assert len(replayed) == summary["cycles"] > 1000, f"{len(replayed)} states of {summary['cycles']} cycles"
    check_plots(states, equipoise.reconcile(RECORDING))
    print(f"python: as in the CSV: {rows} rows; {compared} torques as recorded; errors, readings, replay, plots")
    for name, words in {"first_look": "of the limit", "personalisation": "RMS error", "discrepancy": "hand_load"}.items():
        text = run_notebook(f"{NOTEBOOKS}/{name}.ipynb")
        assert words in text, f"{name}: {text}"
        print(f"python: {name}: {text.strip().splitlines()[0]}", flush=True)
    assert len(glob.glob(f"{NOTEBOOKS}/*.ipynb")) == 3, "a notebook that is not executed"


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"python: {error}")
