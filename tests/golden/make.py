"""Writes static.json: what the Pinocchio rigid-body library says about a made-up person who holds things.

    python3 -m venv venv && venv/bin/pip install pin==4.1.0 && venv/bin/python tests/golden/make.py

Nothing of Equipoise is used. The person's bones, masses, poses and loads are random (fixed seed). Pinocchio's own
recursive Newton-Euler algorithm, with a free-floating pelvis and spherical joints, gives the joint torques twice: the
person alone, and with the load in the hands. The ground's vertical force acts on the feet, where the balance of the
whole body wants it; that the pelvis then needs no external push is checked here.
"""

import json
import pathlib
import re

import numpy as np
import pinocchio as pin

SEED = 20_260_417
GRAVITY_M_PER_S2 = 9.81
DIGITS = 12

# name, parent, nominal offset in the parent over stature (X forward, Y left, Z up, T-pose), share of the mass in %
TREE = [
    ("Pelvis", None, (0.0, 0.0, 0.0), 12.0),
    ("L5", "Pelvis", (-0.01, 0.0, 0.06), 7.0),
    ("L3", "L5", (0.0, 0.0, 0.06), 8.0),
    ("T12", "L3", (0.0, 0.0, 0.06), 7.0),
    ("T8", "T12", (0.0, 0.0, 0.06), 8.0),
    ("Neck", "T8", (0.01, 0.0, 0.08), 1.5),
    ("Head", "Neck", (0.0, 0.0, 0.06), 5.5),
    ("RightShoulder", "T8", (0.0, -0.02, 0.05), 1.0),
    ("RightUpperArm", "RightShoulder", (0.0, -0.08, 0.0), 2.7),
    ("RightForearm", "RightUpperArm", (0.0, -0.17, 0.0), 1.6),
    ("RightHand", "RightForearm", (0.0, -0.15, 0.0), 0.6),
    ("LeftShoulder", "T8", (0.0, 0.02, 0.05), 1.0),
    ("LeftUpperArm", "LeftShoulder", (0.0, 0.08, 0.0), 2.7),
    ("LeftForearm", "LeftUpperArm", (0.0, 0.17, 0.0), 1.6),
    ("LeftHand", "LeftForearm", (0.0, 0.15, 0.0), 0.6),
    ("RightUpperLeg", "Pelvis", (0.0, -0.05, 0.0), 13.0),
    ("RightLowerLeg", "RightUpperLeg", (0.0, 0.0, -0.24), 4.4),
    ("RightFoot", "RightLowerLeg", (0.0, 0.0, -0.24), 1.2),
    ("RightToe", "RightFoot", (0.10, 0.0, -0.04), 0.2),
    ("LeftUpperLeg", "Pelvis", (0.0, 0.05, 0.0), 13.0),
    ("LeftLowerLeg", "LeftUpperLeg", (0.0, 0.0, -0.24), 4.4),
    ("LeftFoot", "LeftLowerLeg", (0.0, 0.0, -0.24), 1.2),
    ("LeftToe", "LeftFoot", (0.10, 0.0, -0.04), 0.2),
]
NAMES = [name for name, *_ in TREE]
PARENT = [-1 if parent is None else NAMES.index(parent) for _, parent, *_ in TREE]

# Which hands hold something, and how heavy it is, kg: one row a case.
LOADS = [(["Right"], 2.0), (["Left"], 6.0), (["Left", "Right"], 4.0), (["Left", "Right"], 15.0),
         (["Left", "Right"], 9.0), (["Right"], 11.0)]


def person(rng):
    height_m = rng.uniform(1.55, 1.95)
    mass_kg = rng.uniform(52.0, 104.0)
    offset_m = [height_m * np.array(at) * rng.uniform(0.9, 1.1) + (rng.normal(0.0, 0.004, 3) if i else 0.0)
                for i, (_, _, at, _) in enumerate(TREE)]
    share = np.array([percent for *_, percent in TREE]) * rng.uniform(0.8, 1.25, len(TREE))
    segment_mass_kg = mass_kg * share / share.sum()
    # Somewhere in the segment: half-way to its first child, or a hand's breadth out where it has none.
    centre_m = []
    for i in range(len(TREE)):
        children = [offset_m[k] for k in range(len(TREE)) if PARENT[k] == i]
        towards = children[0] if children else 0.4 * offset_m[i]
        centre_m.append(0.5 * towards + rng.normal(0.0, 0.012, 3))
    return height_m, offset_m, segment_mass_kg, centre_m


def pinocchio_model(offset_m, segment_mass_kg, centre_m, inertia_kg_m2=None):
    """Inertia about the segments' centres, which no static pose depends on."""
    model = pin.Model()
    model.gravity.linear = np.array([0.0, 0.0, -GRAVITY_M_PER_S2])
    joint_of = []
    for i, name in enumerate(NAMES):
        kind = pin.JointModelFreeFlyer() if i == 0 else pin.JointModelSpherical()
        parent = 0 if i == 0 else joint_of[PARENT[i]]
        joint = model.addJoint(parent, kind, pin.SE3(np.eye(3), offset_m[i]), name)
        inertia = 0.01 * np.eye(3) if inertia_kg_m2 is None else inertia_kg_m2[i]
        model.appendBodyToJoint(joint, pin.Inertia(segment_mass_kg[i], centre_m[i], inertia), pin.SE3.Identity())
        joint_of.append(joint)
    return model, joint_of


def random_configuration(model, joint_of, rng):
    q = pin.neutral(model)
    for i, joint in enumerate(joint_of):
        spread_rad = 1.0 if "Arm" in NAMES[i] or "Leg" in NAMES[i] else 0.25
        turn = pin.Quaternion(pin.exp3(rng.normal(0.0, spread_rad / 2, 3)))
        at = model.joints[joint].idx_q
        if i == 0:
            q[at:at + 3] = rng.normal([0.0, 0.0, 0.95], 0.15)
            at += 3
        q[at:at + 4] = turn.coeffs()  # x, y, z, w
    return q


def torques(model, joint_of, q, force_at):
    """World-frame torque of every joint under vertical forces on segments: {segment: [(point, newtons up)]}."""
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    external = pin.StdVec_Force()
    for _ in range(model.njoints):
        external.append(pin.Force.Zero())
    for segment, forces in force_at.items():
        joint = joint_of[segment]
        for point, newtons in forces:
            force = np.array([0.0, 0.0, newtons])
            about_world = pin.Force(force, np.cross(point, force))
            external[joint] = external[joint] + data.oMi[joint].actInv(about_world)
    zero = np.zeros(model.nv)
    tau = pin.rnea(model, data, q, zero, zero, external)
    pelvis_push = np.abs(tau[:6]).max()
    assert pelvis_push < 1e-9, f"the body is not in balance: {pelvis_push} on the pelvis"
    world = [np.zeros(3)]
    for i in range(1, len(TREE)):
        joint = joint_of[i]
        at = model.joints[joint].idx_v
        world.append(data.oMi[joint].rotation @ tau[at:at + 3])
    return np.array(world)


def case(model, joint_of, rng, hands, load_kg):
    q = random_configuration(model, joint_of, rng)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    frames = [data.oMi[joint] for joint in joint_of]
    centre = pin.centerOfMass(model, data, q)
    mass_kg = pin.computeTotalMass(model)

    weight_n, load_n = mass_kg * GRAVITY_M_PER_S2, load_kg * GRAVITY_M_PER_S2
    left = rng.uniform(0.1, 0.9)
    zeta = {"Left": left, "Right": 1.0 - left}
    first = rng.uniform(0.2, 0.8) if len(hands) == 2 else 1.0
    eta = dict(zip(hands, [first, 1.0 - first]))
    segment = {side: NAMES.index(side + "Hand") for side in hands}
    grip = {side: frames[segment[side]].act(rng.normal(0.0, 0.06, 3)) for side in hands}
    load_at = sum(eta[side] * grip[side] for side in hands)
    cop_wo = np.array([centre[0], centre[1], 0.0])
    cop_wt = (cop_wo * weight_n + np.array([load_at[0], load_at[1], 0.0]) * load_n) / (weight_n + load_n)

    def feet(cop, newtons):
        return {NAMES.index(side + "Foot"): [(cop, zeta[side] * newtons)] for side in zeta}

    alone = torques(model, joint_of, q, feet(cop_wo, weight_n))
    held = {segment[side]: [(grip[side], -eta[side] * load_n)] for side in hands}
    loaded = torques(model, joint_of, q, feet(cop_wt, weight_n + load_n) | held)

    wxyz = [np.roll(pin.Quaternion(frame.rotation).coeffs(), 1) for frame in frames]
    return {
        "pelvis_m": frames[0].translation, "quat": wxyz, "origin_m": [frame.translation for frame in frames],
        "com_m": centre, "load_kg": load_kg, "hands": hands, "hand_point_m": grip, "zeta": zeta, "eta": eta,
        "cop_wo_m": cop_wo[:2], "cop_wt_m": cop_wt[:2], "delta_tau_nm": loaded - alone,
    }


def plain(value, digits=DIGITS):
    if isinstance(value, dict):
        return {key: plain(inner, digits) for key, inner in value.items()}
    if isinstance(value, (list, tuple, np.ndarray)):
        return [plain(inner, digits) for inner in value]
    if isinstance(value, (float, np.floating)):
        return round(float(value), digits) + 0.0  # no "-0.0"
    return value


def write(name, out):
    """One vector a line: short enough to read, long enough to diff."""
    text = json.dumps(out, indent=1)
    text = re.sub(r"\[\s+(-?[\d.e+-]+(?:,\s+-?[\d.e+-]+)*)\s+\]", lambda m: "[" + re.sub(r"\s+", " ", m[1]) + "]", text)
    (pathlib.Path(__file__).parent / name).write_text(text + "\n")


def main():
    rng = np.random.default_rng(SEED)
    height_m, offset_m, segment_mass_kg, centre_m = person(rng)
    model, joint_of = pinocchio_model(offset_m, segment_mass_kg, centre_m)
    out = plain({
        "about": f"Made by tests/golden/make.py with Pinocchio {pin.__version__}, seed {SEED}: a random person, random "
                 "poses, random loads. World: X forward, Y left, Z up; m, kg, N, N m. quat is w, x, y, z, "
                 "world_from_segment. delta_tau_nm belongs to the joint between a segment and its parent, world axes.",
        "command": "pip install pin==4.1.0 && python tests/golden/make.py",
        "gravity": GRAVITY_M_PER_S2, "height_m": height_m, "mass_kg": segment_mass_kg.sum(),
        "segments": NAMES, "parent": PARENT, "offset_in_parent_m": offset_m,
        "segment_mass_kg": segment_mass_kg, "segment_com_m": centre_m,
        "cases": [case(model, joint_of, rng, hands, load_kg) for hands, load_kg in LOADS],
    })
    write("static.json", out)


if __name__ == "__main__":
    main()
