"""Writes motion.json: ground reaction on a person who moves fast with a box, by two rigid-body libraries.

    python3 -m venv venv && venv/bin/pip install pin==4.1.0 mujoco==4.0.0 && venv/bin/python tests/golden/make_motion.py

Nothing of Equipoise is used. Each joint rotates by a sum of sines, so that angular velocities and accelerations are large
in all segments (random, fixed seed). Velocities and accelerations are derivatives of the configuration (5-point stencils).
Pinocchio's recursive Newton-Euler algorithm and MuJoCo's inverse dynamics give the wrench on the free-floating pelvis,
which is that of the surroundings on body and box; they must agree.
"""

import mujoco
import numpy as np
import pinocchio as pin

from make import GRAVITY_M_PER_S2, NAMES, PARENT, person, pinocchio_model, plain, write

SEED = 20_261_127
# Load in the left hand, whether the principal axes of each segment's inertia are the segment's, and number of states.
CASES = [(0.0, True, 5), (0.0, True, 5), (0.0, True, 5), (0.0, False, 3), (3.0, False, 3), (11.0, False, 3)]
# States of the body this far apart are given for second differences. Step of the stencils here.
APART_S, STENCIL_S = 1e-4, 1e-3
# Two algorithms with the same derivatives, N and N m.
AGREEMENT = 1e-6
# Rounding of rotations by 1e-15 changes a second difference by 1e-15 / APART_S**2 = 1e-7 1/s^2.
DIGITS = 15
HAND = NAMES.index("LeftHand")


def gyration_m2(rng):
    """Squares of a solid ellipsoid's radii of gyration about its axes."""
    half_axis_m = rng.uniform(0.03, 0.2, 3)
    return [np.sum(np.delete(half_axis_m, k) ** 2) / 5.0 for k in range(3)]


class Motion:
    """Sums of two sines of 0.3 to 2 Hz."""

    def __init__(self, rng):
        segments = len(NAMES)
        self.amplitude = rng.normal(0.0, 0.2, (2, segments + 1, 3))
        self.amplitude[:, -1] *= 0.5  # of the pelvis' place, m
        self.rate = 2.0 * np.pi * rng.uniform(0.3, 2.0, (2, segments + 1, 3))
        self.phase = rng.uniform(0.0, 2.0 * np.pi, (2, segments + 1, 3))
        self.base = [pin.exp3(rng.normal(0.0, 0.4, 3)) for _ in NAMES]

    def at(self, time_s):
        """Place of the pelvis, and rotation of each segment in its parent."""
        value = (self.amplitude * np.sin(self.rate * time_s + self.phase)).sum(axis=0)
        return value[-1] + [0.0, 0.0, 0.95], [base @ pin.exp3(turn) for base, turn in zip(self.base, value)]


def derivatives(configuration, difference, time_s):
    """Velocity and acceleration: derivatives of the logarithm of the change of configuration, of fourth order."""
    here = configuration(time_s)
    far = [difference(here, configuration(time_s + k * STENCIL_S)) for k in (-2, -1, 1, 2)]
    velocity = (far[0] - 8.0 * far[1] + 8.0 * far[2] - far[3]) / (12.0 * STENCIL_S)
    acceleration = (-far[0] + 16.0 * far[1] + 16.0 * far[2] - far[3]) / (12.0 * STENCIL_S**2)
    return here, velocity, acceleration


def by_pinocchio(model, motion, time_s):
    def configuration(time_s):
        pelvis_m, turns = motion.at(time_s)
        return np.concatenate([pelvis_m] + [pin.Quaternion(turn).normalized().coeffs() for turn in turns])

    q, velocity, acceleration = derivatives(configuration, lambda a, b: pin.difference(model, a, b), time_s)
    data = model.createData()
    pin.forwardKinematics(model, data, q)
    tau = pin.rnea(model, data, q, velocity, acceleration)
    about_world = data.oMi[1].act(pin.Force(tau[:6]))
    return about_world.linear, about_world.angular


def mujoco_model(offset_m, mass_kg, centre_m, inertia_kg_m2, load_kg, grip_m):
    def numbers(values):
        return " ".join(repr(float(value)) for value in values)

    def body(i):
        full = inertia_kg_m2[i]
        six = [full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]
        joint = "<freejoint/>" if i == 0 else '<joint type="ball"/>'
        box = ""
        if i == HAND and load_kg > 0.0:
            # A small solid sphere in place of a point, which MuJoCo does not accept.
            box = (f'<body pos="{numbers(grip_m)}"><inertial pos="0 0 0" mass="{load_kg}" '
                   f'diaginertia="1e-12 1e-12 1e-12"/></body>')
        inside = "".join(body(k) for k in range(len(NAMES)) if PARENT[k] == i)
        return (f'<body name="{NAMES[i]}" pos="{numbers(offset_m[i])}">{joint}<inertial pos="{numbers(centre_m[i])}" '
                f'mass="{float(mass_kg[i])!r}" fullinertia="{numbers(six)}"/>{box}{inside}</body>')

    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler balanceinertia="false" boundinertia="0"/>'
        f'<option gravity="0 0 {-GRAVITY_M_PER_S2}"/><worldbody>{body(0)}</worldbody></mujoco>')


def by_mujoco(model, motion, time_s):
    order = [NAMES.index(model.body(model.jnt_bodyid[k]).name) for k in range(model.njnt)]

    def configuration(time_s):
        pelvis_m, turns = motion.at(time_s)
        wxyz = [np.roll(pin.Quaternion(turns[i]).normalized().coeffs(), 1) for i in order]
        return np.concatenate([pelvis_m] + wxyz)

    def difference(a, b):
        out = np.zeros(model.nv)
        mujoco.mj_differentiatePos(model, out, 1.0, a, b)
        return out

    data = mujoco.MjData(model)
    data.qpos, data.qvel, data.qacc = derivatives(configuration, difference, time_s)
    mujoco.mj_inverse(model, data)
    force_n = data.qfrc_inverse[:3].copy()
    pelvis = data.body("Pelvis")
    moment_nm = pelvis.xmat.reshape(3, 3) @ data.qfrc_inverse[3:6] + np.cross(pelvis.xpos, force_n)
    return force_n, moment_nm


def state(motion, time_s):
    pelvis_m, turns = motion.at(time_s)
    world = []
    for i, turn in enumerate(turns):
        world.append(turn if i == 0 else world[PARENT[i]] @ turn)
    wxyz = [np.roll(pin.Quaternion(turn).normalized().coeffs(), 1) for turn in world]
    return {"pelvis_m": pelvis_m, "quat": wxyz}


def main():
    rng = np.random.default_rng(SEED)
    height_m, offset_m, segment_mass_kg, centre_m = person(rng)
    offset_m[0] = np.zeros(3)
    gyration = [gyration_m2(rng) for _ in NAMES]
    cases = []
    for load_kg, in_segment_axes, states in CASES:
        motion, time_s, grip_m = Motion(rng), rng.uniform(0.0, 10.0), rng.normal(0.0, 0.06, 3)
        axes = np.eye(3) if in_segment_axes else pin.exp3(rng.normal(0.0, 1.0, 3))
        inertia_kg_m2 = [mass_kg * axes @ np.diag(square) @ axes.T for mass_kg, square in zip(segment_mass_kg, gyration)]
        model, joint_of = pinocchio_model(offset_m, segment_mass_kg, centre_m, inertia_kg_m2)
        model.appendBodyToJoint(joint_of[HAND], pin.Inertia(load_kg, grip_m, np.zeros((3, 3))), pin.SE3.Identity())
        reference = by_pinocchio(model, motion, time_s)
        second = by_mujoco(
            mujoco_model(offset_m, segment_mass_kg, centre_m, inertia_kg_m2, load_kg, grip_m), motion, time_s)
        apart = max(np.abs(a - b).max() for a, b in zip(reference, second))
        assert apart < AGREEMENT, f"the libraries differ by {apart}"
        print(f"{load_kg:4} kg: force {np.round(reference[0], 1)} N, libraries within {apart:.1e}")
        cases.append({
            "load_kg": load_kg, "grip_m": grip_m, "inertia_axes": axes, "force_n": reference[0],
            "moment_nm": reference[1],
            "states": [state(motion, time_s + (k - states // 2) * APART_S) for k in range(states)],
        })
    write("motion.json", plain({
        "about": f"Made by tests/golden/make_motion.py with Pinocchio {pin.__version__} and MuJoCo {mujoco.__version__}, "
                 f"seed {SEED}: a random person in random motions. World: X forward, Y left, Z up; m, kg, N, N m. States "
                 "step_s apart; quat is w, x, y, z, world_from_segment. The box is a point of the left hand. Each "
                 "segment's inertia about its centre is its mass times A diag(gyration_m2) A^T, A = inertia_axes. force_n "
                 "and moment_nm, about the world's origin, act on person and box at the middle state.",
        "step_s": APART_S, "height_m": height_m, "offset_m": offset_m, "segment_mass_kg": segment_mass_kg,
        "segment_com_m": centre_m, "gyration_m2": gyration, "cases": cases,
    }, DIGITS))


if __name__ == "__main__":
    main()
