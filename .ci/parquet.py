"""Reads exported tables with pyarrow and pandas and evaluates what it finds: parquet.py FOLDER."""

import json
import math
import sys

import pandas
import pyarrow.parquet

# Columns and the keys of the JSON that say the same.
SAME = {
    "t_s": ["t"], "cycle": ["cycle"], "phase_name": ["phase"], "mass_kg": ["mass_kg"],
    "cop_measured_m_x": ["cop_measured", 0], "cop_estimated_m_y": ["cop_estimated", 1], "com_m_z": ["com", 2],
    "delta_f_n_z": ["delta_f_n", 2], "lifted_mass_kg": ["lifted_mass_kg"], "reach_m": ["reach_m"],
    "l5s1_compression_n": ["l5s1_compression_n"], "dose_damage": ["dose_damage"], "nis": ["nis"],
    "torque_nm_L5S1_y": ["joints", "L5S1", "torque_nm", 1], "torque_sigma_nm_RightElbow": ["joints", "RightElbow", "sigma_nm"],
    "fatigue_LeftKnee": ["fatigue", "LeftKnee"],
}


def at(line, path):
    for key in path:
        if isinstance(line, dict) and key not in line:
            return None
        line = line[key]
    return line


def is_none(value):
    return value is None or value is pandas.NA or (isinstance(value, float) and math.isnan(value))


def check_states(folder):
    table = pyarrow.parquet.read_table(f"{folder}/state.parquet")
    footer = {key.decode(): value.decode() for key, value in table.schema.metadata.items()}
    assert footer["equipoise.type_name"].startswith("equipoise/State/"), footer.keys()
    assert json.loads(footer["equipoise.units"])["torque_nm_L5S1_x"] == "N m"
    levels = json.loads(footer["equipoise.names"])["joint_level"]
    columns = {name: table[name].to_pylist() for name in [*SAME, "joint_level_L5S1", "valid_names"]}
    rows = 0
    with open(f"{folder}/states.jsonl", encoding="utf-8") as lines:
        for rows, line in enumerate(map(json.loads, lines), 1):
            for name, path in SAME.items():
                value, expected = columns[name][rows - 1], at(line, path)
                assert value == expected, f"{name} at {line['t']}: {value}, JSON {expected}"
            level, joints = columns["joint_level_L5S1"][rows - 1], line.get("joints")
            assert (joints is None) == (level is None)
            assert joints is None or levels[str(level)] == joints["L5S1"]["level"]
            assert columns["valid_names"][rows - 1].split() == line["valid"]
    unseen = [name for name in SAME if all(value is None for value in columns[name])]
    assert not unseen, f"never valid, so nothing was compared: {unseen}"
    assert rows == table.num_rows > 1000, f"{table.num_rows} rows, {rows} lines"
    return table.num_rows


def check_csv(folder, topic):
    parquet = pandas.read_parquet(f"{folder}/{topic}.parquet")
    # Every fiftieth row is enough of a minute's thousands.
    csv = pandas.read_csv(f"{folder}/{topic}.csv", keep_default_na=True, float_precision="round_trip", low_memory=False,
                          skiprows=lambda number: number > 0 and (number - 1) % 50 != 0)
    with open(f"{folder}/{topic}.csv", encoding="utf-8") as lines:
        rows = sum(1 for _ in lines) - 1
    assert list(parquet.columns) == list(csv.columns), topic
    assert len(parquet) == rows > 100, f"{topic}: {len(parquet)} and {rows} rows"
    for name in parquet.columns:
        if name == "valid_names":  # an empty text is nothing in a CSV
            continue
        for one, other in zip(parquet[name].iloc[::50], csv[name], strict=True):
            assert (is_none(one) and is_none(other)) or one == other, f"{topic}.{name}: {one} and {other}"
    return f"{topic} {len(parquet)} rows of {len(parquet.columns)} columns"


def check_json_lines(folder, topic):
    parquet = pyarrow.parquet.read_table(f"{folder}/{topic}.parquet")
    with open(f"{folder}/{topic}.jsonl", encoding="utf-8") as lines:
        rows = [json.loads(line) for line in lines]
    assert len(rows) == parquet.num_rows, topic
    for number in range(0, len(rows), 50):
        there = {name: value for name, value in parquet.slice(number, 1).to_pylist()[0].items() if value is not None}
        assert rows[number] == there, f"{topic} row {number}"


def main():
    folder = sys.argv[1]
    states = check_states(folder)
    topics = [check_csv(folder, topic) for topic in ("state", "suit", "ground", "cycle")]
    for topic in ("state", "suit", "ground", "cycle"):
        check_json_lines(folder, topic)
    print(f"parquet: {states} states are the replay's; " + ", ".join(topics))


if __name__ == "__main__":
    try:
        main()
    except AssertionError as error:
        sys.exit(f"parquet: {error}")
