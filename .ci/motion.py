"""Reads files for OpenSim and a C3D file with OpenSim and ezc3d, and compares them with a table of states: motion.py FOLDER."""

import math
import sys

import ezc3d
import numpy
import opensim
import pyarrow.parquet

AXES = "xyz"
COMPARED_MIN = 100
# The files have times in us, and forces change by some N per ms.
FORCE_N, POINT_M, CENTRE_M, TORQUE_NM = 0.02, 1e-5, 1e-4, 0.01


def instants(path):
    """Columns of the states, one row per instant; null is NaN. Times in s since the start of the recording."""
    table = pyarrow.parquet.read_table(path)
    started = int(table.schema.metadata[b"equipoise.started_monotonic_ns"])
    numbers = [field.name for field in table.schema if field.name not in ("phase_name", "valid_names")]
    columns = {name: table[name].to_numpy(zero_copy_only=False).astype(float) for name in numbers
               if name.startswith(("ground_force", "cop_measured_m", "segment_origin", "torque_", "com_m"))}
    stamps = numpy.array([stamp or 0 for stamp in table["suit_sample_time_ns"].to_pylist()], dtype=numpy.int64)
    rows = numpy.flatnonzero(stamps > numpy.maximum.accumulate(numpy.concatenate([[0], stamps[:-1]])))
    return (stamps[rows] - started) / 1e9, {name: column[rows] for name, column in columns.items()}


def station(vector):
    """A vector of OpenSim's ground frame (X forward, Y up, Z right) in the station's world."""
    x, y, z = vector
    return [x, -z, y]


class Validator:
    def __init__(self, times, columns):
        self.times, self.columns = times, columns

    def compare(self, what, times, values, name, within):
        """Values of a file against a column, interpolated between valid instants that are not far apart."""
        column, compared = self.columns[name], 0
        for time, value in zip(times, values, strict=True):
            after = min(max(int(numpy.searchsorted(self.times, time)), 1), len(self.times) - 1)
            before = after - 1
            gap = self.times[after] - self.times[before]
            fraction = (time - self.times[before]) / gap
            expected = column[before] + fraction * (column[after] - column[before])
            if math.isnan(value) or not -1e-6 <= fraction <= 1 + 1e-6:
                continue
            # At an instant itself the other one need not be valid.
            nearest = before if fraction < 0.5 else after
            if abs(time - self.times[nearest]) < 2e-6:
                expected = column[nearest]
            assert abs(value - expected) <= within, f"{what} {name} at {time}: {value}, state {expected}"
            compared += 1
        assert compared > COMPARED_MIN, f"{what} {name}: {compared} values compared"
        return compared


def check_ground(validator, path):
    table, storage = opensim.TimeSeriesTable(path), opensim.Storage(path)
    labels, times = list(table.getColumnLabels()), list(table.getIndependentColumn())
    assert labels[:6] == [f"ground_force_{kind}{axis}" for kind in "vp" for axis in AXES], labels
    assert storage.getSize() == len(times) > COMPARED_MIN and storage.getColumnLabels().getSize() == len(labels) + 1
    values = table.getMatrix().to_numpy()
    assert numpy.isfinite(values).all(), "OpenSim's tools read no NaN"
    assert numpy.ptp(numpy.diff(times)) < 2e-6, "a .mot file has a constant interval"
    for axis, force in zip(AXES, station(values[:, :3].T)):
        validator.compare(".mot", times, force, f"ground_force_n_{axis}", FORCE_N)
    for axis, point in zip("xy", station(values[:, 3:6].T)):
        validator.compare(".mot", times, point, f"cop_measured_m_{axis}", CENTRE_M)
    if len(labels) == 9:
        free = values[:, 7]
        assert (values[:, [6, 8]] == 0).all() and numpy.abs(free).max() < 30, f"free moment of {free.max()} N m"
    return f"{len(times)} rows of {len(labels)} ground columns"


def check_torques(validator, path):
    table, storage = opensim.TimeSeriesTable(path), opensim.Storage(path)
    labels, times = list(table.getColumnLabels()), list(table.getIndependentColumn())
    values = table.getMatrix().to_numpy()
    assert storage.getSize() == len(times) and len(labels) == 88 and numpy.isfinite(values).all()
    for first in range(0, len(labels), 4):
        joint = labels[first].removesuffix("_overload_torque_x")
        for axis, torque in zip(AXES, station(values[:, first:first + 3].T)):
            validator.compare(".sto", times, torque, f"torque_nm_{joint}_{axis}", TORQUE_NM)
        validator.compare(".sto", times, values[:, first + 3], f"torque_sigma_nm_{joint}", TORQUE_NM)
    return f"{len(times)} rows of torques"


def check_markers(validator, path, segments):
    table, markers = opensim.TimeSeriesTableVec3(path), opensim.MarkerData(path)
    times, names = list(table.getIndependentColumn()), list(table.getColumnLabels())
    assert markers.getNumFrames() == len(times) == int(table.getTableMetaDataString("NumFrames"))
    assert len(names) == len(segments) == 23 and markers.getUnits().getLabel() == "millimeters"
    # Kept alive: the matrix is a view.
    flat = table.flatten()
    values = flat.getMatrix().to_numpy() / 1000
    for index, segment in enumerate(segments):
        for axis, position in zip(AXES, station(values[:, 3 * index:3 * index + 3].T)):
            validator.compare(".trc", times, position, f"segment_origin_m_{segment}_{axis}", POINT_M)
    return f"{len(times)} frames of {len(names)} markers"


def check_c3d(validator, path, segments):
    file = ezc3d.c3d(path, extract_forceplat_data=True)
    parameters, points = file["parameters"], file["data"]["points"]
    frames, rate = points.shape[2], parameters["POINT"]["RATE"]["value"][0]
    begin = parameters["EQUIPOISE"]["BEGIN_S"]["value"][0]
    # The begin has 32 bits, so the times are taken from the table.
    start = validator.times[numpy.argmin(numpy.abs(validator.times - begin))]
    times = start + numpy.arange(frames) / rate
    labels = parameters["POINT"]["LABELS"]["value"]
    assert len(labels) == len(set(labels)) == 47 and labels[23:25] == ["CentreOfMass", "CentreOfPressure"], labels
    assert parameters["POINT"]["MOMENTS"]["value"] == labels[25:]
    residuals = file["data"]["meta_points"]["residuals"][0]
    assert ((residuals < 0) == numpy.isnan(points[0])).all() and (residuals < 0).any() and (residuals >= 0).any()
    for index, segment in enumerate(segments):
        for axis in range(3):
            validator.compare("C3D", times, points[axis, index] / 1000, f"segment_origin_m_{segment}_{AXES[axis]}", POINT_M)
    for axis in range(3):
        validator.compare("C3D", times, points[axis, 25] / 1000, f"torque_nm_L5S1_{AXES[axis]}", TORQUE_NM)
    platform = file["data"]["platform"][0]
    assert platform["unit_force"] == "N" and platform["unit_moment"] == "Nmm"
    for axis in range(3):
        validator.compare("platform", times, platform["force"][axis], f"ground_force_n_{AXES[axis]}", FORCE_N)
    loaded = platform["force"][2] > 100
    for axis in range(2):
        centre = numpy.where(loaded, platform["center_of_pressure"][axis] / 1000, math.nan)
        validator.compare("platform", times, centre, f"cop_measured_m_{AXES[axis]}", CENTRE_M)
    sigma = file["data"]["analogs"][0, 6] / 1000
    validator.compare("C3D", times, sigma, "torque_sigma_nm_L5S1", TORQUE_NM)
    return f"{frames} C3D frames"


def main():
    folder = sys.argv[1]
    opensim.Logger.setLevelString("warn")
    validator = Validator(*instants(f"{folder}/live.parquet"))
    segments = [name.removeprefix("segment_origin_m_").removesuffix("_x") for name in validator.columns
                if name.startswith("segment_origin_m_") and name.endswith("_x")]
    results = [
        check_ground(validator, f"{folder}/opensim/ground_reaction.mot"),
        check_torques(validator, f"{folder}/opensim/overload_torques.sto"),
        check_markers(validator, f"{folder}/opensim/joint_centres.trc", segments),
        check_c3d(validator, f"{folder}/live.c3d", segments),
    ]
    print("motion: " + ", ".join(results))


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"motion: {error}")
