/* Reads the states of an Equipoise station, from C and C++.
 *
 *     cargo build --release -p equipoise-c
 *     cc -I clients/c controller.c -L target/release -lequipoise_c
 *
 * clients/c/controller.c is a complete program; docs/consumers/c.md lists the checks before a value is used.
 *
 * Library and daemon must be of one release, and run as the same user. The directory of the bus is that of
 * EQUIPOISE_BUS_ROOT, as for the daemon.
 *
 * Generated from clients/c/equipoise.h.in and the declarations in Rust: do not edit.
 *
 *     EQUIPOISE_WRITE=1 cargo test -p equipoise-c --test generated
 */
#ifndef EQUIPOISE_H
#define EQUIPOISE_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define EQUIPOISE_JOINTS 22
#define EQUIPOISE_SEGMENTS 23

/* Hash of the fields of all structs and of all names and numbers. See equipoise_options. */
#define EQUIPOISE_STATE_TYPE "equipoise/State/5"
#define EQUIPOISE_LAYOUT UINT64_C(0xf61a2221577eca0a)

/* Invalid reasons: bits of equipoise_state.valid. */
/* No suit sample for more than two sample periods. */
#define EQUIPOISE_REASON_SUIT_STALE (UINT64_C(1) << 0)
/* No ground sample for more than two sample periods. */
#define EQUIPOISE_REASON_GROUND_STALE (UINT64_C(1) << 1)
/* The subject's mass distribution is not identified. */
#define EQUIPOISE_REASON_NOT_IDENTIFIED (UINT64_C(1) << 2)
/* The motion exceeds what the equations in use cover. */
#define EQUIPOISE_REASON_MOVING (UINT64_C(1) << 3)
/* The vertical force is too small, or the feet are beyond the plate. */
#define EQUIPOISE_REASON_FEET_OFF_PLATE (UINT64_C(1) << 4)
/* The external force is below the load threshold: no load is assumed. */
#define EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD (UINT64_C(1) << 5)
/* The model changed within the last second. */
#define EQUIPOISE_REASON_MODEL_CHANGED (UINT64_C(1) << 6)
/* Device time is not tied to host time, or the lag between the streams contradicts the data. */
#define EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED (UINT64_C(1) << 7)
/* The load's position, by the two centres of pressure, is far from the hands. */
#define EQUIPOISE_REASON_LOAD_NOT_AT_HANDS (UINT64_C(1) << 8)
/* The subject's mass is neither configured nor measured. */
#define EQUIPOISE_REASON_MASS_UNKNOWN (UINT64_C(1) << 9)
/* The segment lengths are unavailable, and with them the centre of mass. */
#define EQUIPOISE_REASON_BODY_UNKNOWN (UINT64_C(1) << 10)
/* The plate reports a fault. */
#define EQUIPOISE_REASON_PLATE_FAULT (UINT64_C(1) << 11)
/* The ground devices provide no centre of pressure in the world, and the position of the feet is unavailable. */
#define EQUIPOISE_REASON_COP_NOT_MEASURED (UINT64_C(1) << 12)
/* Quick motion raised the detection limit: the external force is below it, but a load cannot be excluded. */
#define EQUIPOISE_REASON_LOAD_BELOW_DETECTION_LIMIT (UINT64_C(1) << 13)
/* The subject's position on the plate is unavailable: the suit's registration is lost. */
#define EQUIPOISE_REASON_POSITION_UNKNOWN (UINT64_C(1) << 14)
/* The ground's readings are implausible for a body or a working device: jumps, repetitions, or traction. */
#define EQUIPOISE_REASON_GROUND_IMPLAUSIBLE (UINT64_C(1) << 15)
/* The suit's poses are implausible for a body or a working suit: repetitions, jumps, or separated joints. */
#define EQUIPOISE_REASON_SUIT_IMPLAUSIBLE (UINT64_C(1) << 16)
/* The ground force is less than the body weight: a foot off the plate, a supporting hand, or a changed gain of a
   device. */
#define EQUIPOISE_REASON_WEIGHT_MISSING (UINT64_C(1) << 17)

/* Sets of reasons that invalidate a value: it is valid if no bit of its set is raised. Invalid values are 0. */
#define EQUIPOISE_INVALIDATES_GROUND_FORCE \
    (EQUIPOISE_REASON_GROUND_STALE | EQUIPOISE_REASON_PLATE_FAULT | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_COP_MEASURED \
    (EQUIPOISE_REASON_GROUND_STALE | EQUIPOISE_REASON_FEET_OFF_PLATE | \
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_COM \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_POSITION_UNKNOWN | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_COP_ESTIMATED \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_POSITION_UNKNOWN | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_DELTA_F \
    (EQUIPOISE_REASON_GROUND_STALE | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | \
     EQUIPOISE_REASON_MASS_UNKNOWN | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_RESIDUAL \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_GROUND_STALE | \
     EQUIPOISE_REASON_NOT_IDENTIFIED | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_MODEL_CHANGED | \
     EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | EQUIPOISE_REASON_MASS_UNKNOWN | \
     EQUIPOISE_REASON_BODY_UNKNOWN | EQUIPOISE_REASON_PLATE_FAULT | \
     EQUIPOISE_REASON_COP_NOT_MEASURED | EQUIPOISE_REASON_POSITION_UNKNOWN | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_LIFTED_MASS \
    (EQUIPOISE_REASON_GROUND_STALE | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD | \
     EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | EQUIPOISE_REASON_MASS_UNKNOWN | \
     EQUIPOISE_REASON_BODY_UNKNOWN | EQUIPOISE_REASON_PLATE_FAULT | \
     EQUIPOISE_REASON_COP_NOT_MEASURED | EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | \
     EQUIPOISE_REASON_SUIT_IMPLAUSIBLE | EQUIPOISE_REASON_WEIGHT_MISSING)
#define EQUIPOISE_INVALIDATES_LOW_BACK \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_GROUND_STALE | \
     EQUIPOISE_REASON_NOT_IDENTIFIED | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_MODEL_CHANGED | \
     EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | EQUIPOISE_REASON_LOAD_NOT_AT_HANDS | \
     EQUIPOISE_REASON_MASS_UNKNOWN | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_LOAD_BELOW_DETECTION_LIMIT | EQUIPOISE_REASON_POSITION_UNKNOWN | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE | \
     EQUIPOISE_REASON_WEIGHT_MISSING)
#define EQUIPOISE_INVALIDATES_TORQUES \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_GROUND_STALE | \
     EQUIPOISE_REASON_NOT_IDENTIFIED | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD | \
     EQUIPOISE_REASON_MODEL_CHANGED | EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | \
     EQUIPOISE_REASON_LOAD_NOT_AT_HANDS | EQUIPOISE_REASON_MASS_UNKNOWN | \
     EQUIPOISE_REASON_BODY_UNKNOWN | EQUIPOISE_REASON_PLATE_FAULT | \
     EQUIPOISE_REASON_COP_NOT_MEASURED | EQUIPOISE_REASON_LOAD_BELOW_DETECTION_LIMIT | \
     EQUIPOISE_REASON_POSITION_UNKNOWN | EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | \
     EQUIPOISE_REASON_SUIT_IMPLAUSIBLE | EQUIPOISE_REASON_WEIGHT_MISSING)
#define EQUIPOISE_INVALIDATES_POSE \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_SUIT_COM \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_POSITION_UNKNOWN | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_LOAD_HAND_DISTANCE \
    (EQUIPOISE_REASON_SUIT_STALE | EQUIPOISE_REASON_GROUND_STALE | \
     EQUIPOISE_REASON_NOT_IDENTIFIED | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD | \
     EQUIPOISE_REASON_MODEL_CHANGED | EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED | \
     EQUIPOISE_REASON_MASS_UNKNOWN | EQUIPOISE_REASON_BODY_UNKNOWN | \
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_LOAD_BELOW_DETECTION_LIMIT | EQUIPOISE_REASON_POSITION_UNKNOWN | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE | \
     EQUIPOISE_REASON_WEIGHT_MISSING)

enum equipoise_phase {
    EQUIPOISE_PHASE_WAITING = 0,
    EQUIPOISE_PHASE_IDENTIFYING = 1,
    EQUIPOISE_PHASE_MONITORING = 2,
    EQUIPOISE_PHASE_DEGRADED = 3
};

/* Overload level of a joint. UNDECIDED: the uncertainty of the torque covers two levels. */
enum equipoise_level {
    EQUIPOISE_LEVEL_NONE = 0,
    EQUIPOISE_LEVEL_GREEN = 1,
    EQUIPOISE_LEVEL_ORANGE = 2,
    EQUIPOISE_LEVEL_RED = 3,
    EQUIPOISE_LEVEL_ABOVE_MAX = 4,
    EQUIPOISE_LEVEL_UNDECIDED = 5
};

enum equipoise_sharing {
    EQUIPOISE_SHARING_GEOMETRY = 0,
    EQUIPOISE_SHARING_MEASURED = 1
};

/* Quantities that the station's sensors do not provide: bits of equipoise_state.unavailable. They are 0 and invalid. */
/* suit_com_m: the suit does not send it (MVN type 24). */
#define EQUIPOISE_UNAVAILABLE_SUIT_COM (UINT32_C(1) << 0)
/* Horizontal components of ground_force_n: insoles measure only normal forces. */
#define EQUIPOISE_UNAVAILABLE_SHEAR (UINT32_C(1) << 1)

/* Devices in the ground sample: bits of equipoise_state.ground_devices. */
/* The force plate of [ground]. */
#define EQUIPOISE_GROUND_PLATE (UINT32_C(1) << 0)
/* The force plate of [ground.second]. */
#define EQUIPOISE_GROUND_SECOND_PLATE (UINT32_C(1) << 1)
/* Insoles. */
#define EQUIPOISE_GROUND_INSOLES (UINT32_C(1) << 2)

/* Source of the segment lengths. */
enum equipoise_body_source {
    EQUIPOISE_BODY_SOURCE_UNKNOWN = 0,
    EQUIPOISE_BODY_SOURCE_POSES = 1,
    EQUIPOISE_BODY_SOURCE_NULL_POSE = 2,
    EQUIPOISE_BODY_SOURCE_STORED = 3
};

/* Reason why the suit's null pose is not used. */
enum equipoise_body_rejected {
    EQUIPOISE_BODY_REJECTED_NONE = 0,
    EQUIPOISE_BODY_REJECTED_IMPOSSIBLE = 1,
    EQUIPOISE_BODY_REJECTED_STALE = 2,
    EQUIPOISE_BODY_REJECTED_OTHER_CHARACTER = 3,
    EQUIPOISE_BODY_REJECTED_CONTRADICTS_POSES = 4,
    EQUIPOISE_BODY_REJECTED_CONTRADICTS_WORKER = 5
};

enum equipoise_foot_outline {
    EQUIPOISE_FOOT_OUTLINE_STATURE = 0,
    EQUIPOISE_FOOT_OUTLINE_SUIT = 1
};

enum equipoise_acceleration {
    EQUIPOISE_ACCELERATION_POSITIONS = 0,
    EQUIPOISE_ACCELERATION_SUIT = 1
};

/* Indices of arrays of EQUIPOISE_JOINTS. */
enum equipoise_joint {
    EQUIPOISE_JOINT_L5S1 = 0,
    EQUIPOISE_JOINT_L4L3 = 1,
    EQUIPOISE_JOINT_L1T12 = 2,
    EQUIPOISE_JOINT_T9T8 = 3,
    EQUIPOISE_JOINT_T1C7 = 4,
    EQUIPOISE_JOINT_C1_HEAD = 5,
    EQUIPOISE_JOINT_RIGHT_T4_SHOULDER = 6,
    EQUIPOISE_JOINT_RIGHT_SHOULDER = 7,
    EQUIPOISE_JOINT_RIGHT_ELBOW = 8,
    EQUIPOISE_JOINT_RIGHT_WRIST = 9,
    EQUIPOISE_JOINT_LEFT_T4_SHOULDER = 10,
    EQUIPOISE_JOINT_LEFT_SHOULDER = 11,
    EQUIPOISE_JOINT_LEFT_ELBOW = 12,
    EQUIPOISE_JOINT_LEFT_WRIST = 13,
    EQUIPOISE_JOINT_RIGHT_HIP = 14,
    EQUIPOISE_JOINT_RIGHT_KNEE = 15,
    EQUIPOISE_JOINT_RIGHT_ANKLE = 16,
    EQUIPOISE_JOINT_RIGHT_BALL_FOOT = 17,
    EQUIPOISE_JOINT_LEFT_HIP = 18,
    EQUIPOISE_JOINT_LEFT_KNEE = 19,
    EQUIPOISE_JOINT_LEFT_ANKLE = 20,
    EQUIPOISE_JOINT_LEFT_BALL_FOOT = 21
};

/* Result of one cycle. World: X forward, Y left, Z up, origin of the station.
 *
 * A value is valid only if no reason that invalidates it is raised in valid. No value is NaN.
 */
typedef struct equipoise_state {
    /* Number of the cycle since the daemon's start, from 1. */
    uint64_t cycle;
    /* Due time of the cycle, CLOCK_MONOTONIC ns. */
    uint64_t time_ns;
    /* Sample time that the results refer to, CLOCK_MONOTONIC ns; 0 before the first sample. */
    uint64_t suit_sample_time_ns;
    /* Age of the newest suit sample at time_ns, ns. */
    uint64_t suit_age_ns;
    /* Age of the newest ground sample at time_ns, ns; u64::MAX before the first. */
    uint64_t ground_age_ns;
    /* Delay of suit_sample_time_ns behind the newest processed suit sample, ns. */
    uint64_t group_delay_ns;
    /* Invalid reasons: EQUIPOISE_REASON_…; 0 if all values are valid. */
    uint64_t valid;
    /* An enum equipoise_phase. */
    uint32_t phase;
    /* 1 while the pose is static (window of 20 samples). */
    uint32_t static_pose;
    /* 1 after the stop criterion of the identification is met. */
    uint32_t converged;
    /* Number of static poses that updated the filter. */
    uint32_t poses_used;
    /* Number of the stance: increments at every step of the feet. */
    uint32_t stance;
    /* Index of the suggested pose in the library of poses; UINT32_MAX if none is suggested. */
    uint32_t suggested_pose;
    /* Number of motion samples that updated the filter (method = "static+dynamic"). */
    uint32_t motion_samples_used;
    /* Source of foot_load_fraction: an enum equipoise_sharing. */
    uint32_t sharing_source;
    /* Index of the joint closest to its torque limit; UINT32_MAX while no torque is valid. */
    uint32_t worst_joint;
    /* Number of lifts in the cumulative dose. */
    uint32_t lifts;
    /* Source of the segment lengths: an enum equipoise_body_source. */
    uint32_t body_source;
    /* Source of the foot outlines: an enum equipoise_foot_outline. */
    uint32_t foot_outline_source;
    /* Reason why the last body dimensions from the suit are not used: an enum equipoise_body_rejected. */
    uint32_t body_rejected;
    /* Quantities that this station's sensors do not provide: EQUIPOISE_UNAVAILABLE_…. They are zero and invalid,
       regardless of valid. */
    uint32_t unavailable;
    /* Source of the body's accelerations: an enum equipoise_acceleration. */
    uint32_t acceleration_source;
    /* Devices in the ground sample: EQUIPOISE_GROUND_…. */
    uint32_t ground_devices;
    /* Overload level of each joint: an enum equipoise_level. */
    uint32_t joint_level[EQUIPOISE_JOINTS];
    /* Measured centre of pressure, world x and y, m. */
    double cop_measured_m[2];
    /* 1-σ of cop_measured_m per axis, m. */
    double cop_measured_sigma_m[2];
    /* Centre of pressure of the same motion without the load, by the identified model, world x and y, m. */
    double cop_estimated_m[2];
    /* 1-σ of cop_estimated_m per axis, m. */
    double cop_sigma_m[2];
    /* Estimated centre of mass of the unloaded body, world, m. */
    double com_m[3];
    /* Centre of mass computed by the suit's software, anchored to the floor as the segments are, world, m; see
       unavailable. */
    double suit_com_m[3];
    /* Ground reaction force on the person, world axes, N; see unavailable for its horizontal part. */
    double ground_force_n[3];
    /* External force: measured ground reaction minus that of the unloaded body in the same motion, world axes,
       N; x and y: always 0, not published. */
    double delta_f_n[3];
    /* 1-σ of the vertical component of delta_f_n, N. */
    double delta_f_sigma_n;
    /* Body mass in use, kg. */
    double mass_kg;
    /* ζ: fraction of the ground reaction under the left and the right foot, 0 to 1. */
    double foot_load_fraction[2];
    /* η: fraction of the load in the left and the right hand, 0 to 1. */
    double hand_load_fraction[2];
    /* 1-σ of foot_load_fraction; the errors of the two feet are equal and opposite. */
    double foot_load_fraction_sigma;
    /* 1-σ of hand_load_fraction; the errors of the two hands are equal and opposite. */
    double hand_load_fraction_sigma;
    /* Horizontal distance of the load from the line between the hands, m. */
    double load_hand_distance_m;
    /* Mass of the load in the hands, kg. */
    double lifted_mass_kg;
    /* 1-σ of lifted_mass_kg, kg. */
    double lifted_mass_sigma_kg;
    /* Horizontal distance of the load from the midpoint of the ankles, m. */
    double reach_m;
    /* 1-σ of reach_m, m. */
    double reach_sigma_m;
    /* Largest variance of an identified parameter, m² (P_jj in the paper). */
    double variance_max_m2;
    /* Predicted 1-σ of the centre of pressure over the pose library, m. */
    double predicted_cop_sigma_m;
    /* Normalised innovation squared of the last static pose, 2 degrees of freedom; 0 before the first. */
    double nis;
    /* Factor on the prior's covariance after a conflict with the first poses, ≥ 1; 1 without a conflict, 0
       before the filter's start. */
    double prior_inflation;
    /* Difference from the suggested pose: RMS joint angle, or the remaining rotation of the whole body, rad. */
    double pose_mismatch_rad;
    /* Skew: estimated delay of the suit's sample times relative to the ground's, s. */
    double suit_skew_s;
    /* 1-σ of suit_skew_s, s; 0 until unloaded motion has determined the skew. */
    double suit_skew_sigma_s;
    /* Net moment of upper body and load at L5/S1 about the horizontal axes, N m. */
    double l5s1_moment_nm;
    /* 1-σ of l5s1_moment_nm, N m. */
    double l5s1_moment_sigma_nm;
    /* Estimated compression of the L5/S1 disc, N. */
    double l5s1_compression_n;
    /* 1-σ of l5s1_compression_n, N. */
    double l5s1_compression_sigma_n;
    /* Cumulative damage of the low back, 1 at failure (LiFFT, Gallagher et al. 2017). */
    double dose_damage;
    /* Probability of a high-risk job at this dose, 0 to 1. */
    double dose_probability;
    /* Direction in which a motion of the load relieves the worst joint: unit vector, world axes; zero if no
       motion does. */
    double advice_direction[3];
    /* Reduction of the worst joint's torque by a motion in that direction, N m per cm. */
    double advice_gain_nm_per_cm;
    /* Segment origins (proximal joint centres) in MVN order, world, m; with position_unknown, their position and
       heading on the floor are not those of the station. */
    double segment_origin_m[EQUIPOISE_SEGMENTS][3];
    /* Overload torque of each joint (Eq. 15), world axes, N m. */
    double torque_nm[EQUIPOISE_JOINTS][3];
    /* 1-σ of the magnitude of each overload torque, N m. */
    double torque_sigma_nm[EQUIPOISE_JOINTS];
    /* Covariance of the horizontal components of each overload torque: xx, xy, yy, (N m)². The vertical
       component has none. */
    double torque_covariance_nm2[EQUIPOISE_JOINTS][3];
    /* Torque limit τ_max of each joint of this subject, N m. */
    double torque_limit_nm[EQUIPOISE_JOINTS];
    /* Overloading fatigue of each joint, 0 to 1 (Lorenzini et al. 2019). */
    double fatigue[EQUIPOISE_JOINTS];
    /* Time at which egress passed the state to the bus, CLOCK_MONOTONIC ns; 0 within the loop. The only field
       that differs in a replay. */
    uint64_t published_ns;
} equipoise_state;

/* A current state, with its age. With any outcome other than EQUIPOISE_OK, all reasons are raised in state.valid, ages
 * are UINT64_MAX, and nothing of an earlier reading remains.
 */
typedef struct equipoise_reading {
    equipoise_state state;
    /* Time of receipt, CLOCK_MONOTONIC ns. */
    uint64_t received_ns;
    /* Time from the cycle's due time to the return of this reading, ns. */
    uint64_t age_ns;
    /* Time from state.suit_sample_time_ns, which torques, forces and centres refer to, to the return of this reading,
       ns; UINT64_MAX before the first sample. */
    uint64_t sample_age_ns;
    /* States since the last new one that were not returned: overwritten before they were read, or too old. */
    uint64_t missed;
    /* 1 if the daemon was restarted between the last new state and this one. */
    uint32_t restarted;
    /* 1 if it was not returned before; equipoise_latest may return a state again. */
    uint32_t is_new;
} equipoise_reading;

/* Result about the newest suit sample whose wrench has arrived; the state lies up to a tenth of a second behind it and
 * is more accurate. World and validity as for equipoise_state.
 */
typedef struct equipoise_early_state {
    /* Number of the cycle that computed or last invalidated it: equipoise_state.cycle. */
    uint64_t cycle;
    /* Due time of that cycle, CLOCK_MONOTONIC ns. */
    uint64_t time_ns;
    /* Sample time that the results refer to, CLOCK_MONOTONIC ns; 0 before the first sample. */
    uint64_t sample_time_ns;
    /* Age of that sample at time_ns, ns. */
    uint64_t sample_age_ns;
    /* Invalid reasons: EQUIPOISE_REASON_…; 0 if all values are valid. */
    uint64_t valid;
    /* Source of the body's accelerations: an enum equipoise_acceleration. */
    uint32_t acceleration_source;
    /* 1 once enough early states were compared with the states of the same samples. */
    uint32_t calibrated;
    /* Estimated centre of mass of the unloaded body, world, m. */
    double com_m[3];
    /* Centre of pressure of the same motion without the load, by the identified model, world x and y, m. */
    double cop_estimated_m[2];
    /* 1-σ of cop_estimated_m per axis, m. */
    double cop_sigma_m[2];
    /* External force: measured ground reaction minus that of the unloaded body in the same motion, world axes,
       N; x and y: always 0, not published. */
    double delta_f_n[3];
    /* 1-σ of the vertical component of delta_f_n, N. */
    double delta_f_sigma_n;
    /* Grip of the left and the right hand, world, m; valid with com_m. */
    double hand_m[2][3];
    /* Velocity of the grips, world, m/s; valid with cop_estimated_m, because without enough samples there is
       none. */
    double hand_velocity_m_per_s[2][3];
    /* Mass of the load in the hands, kg. */
    double lifted_mass_kg;
    /* 1-σ of lifted_mass_kg, kg. */
    double lifted_mass_sigma_kg;
    /* Overload torque of each joint (Eq. 15), world axes, N m. */
    double torque_nm[EQUIPOISE_JOINTS][3];
    /* 1-σ of the magnitude of each overload torque, N m. */
    double torque_sigma_nm[EQUIPOISE_JOINTS];
    /* Time at which egress passed the early state to the bus, CLOCK_MONOTONIC ns; 0 within the loop. The only
       field that differs in a replay. */
    uint64_t published_ns;
} equipoise_early_state;

/* A current early state, with its ages. With any outcome other than EQUIPOISE_OK, all reasons are raised in early.valid
 * and ages are UINT64_MAX.
 */
typedef struct equipoise_early_reading {
    equipoise_early_state early;
    /* Time of receipt, CLOCK_MONOTONIC ns. */
    uint64_t received_ns;
    /* Time from the cycle's due time to the return of this reading, ns. */
    uint64_t age_ns;
    /* Time from early.sample_time_ns to the return of this reading, ns. */
    uint64_t sample_age_ns;
    /* 1 if it was not returned before. */
    uint32_t is_new;
    /* Always 0. */
    uint32_t reserved;
} equipoise_early_reading;

enum equipoise_outcome {
    /* Done. */
    EQUIPOISE_OK = 0,
    /* No new state arrived in time: the daemon is not running, or hangs. */
    EQUIPOISE_SILENT = 1,
    /* States arrived, but all were too old to be returned. */
    EQUIPOISE_STALE = 2,
    /* The daemon has another CLOCK_MONOTONIC: both must run in one time namespace. */
    EQUIPOISE_OTHER_CLOCK = 3,
    /* The bus cannot be joined or read. An open consumer rejoins by itself. */
    EQUIPOISE_BUS = 4,
    /* The call is invalid: a null pointer, another thread's consumer, another header. */
    EQUIPOISE_WRONG_USE = 5,
    /* A defect of this library. */
    EQUIPOISE_DEFECT = 6
};

/* Initialise with EQUIPOISE_OPTIONS_DEFAULT: it contains the hash of the header that the program was compiled with, and
 * the library rejects another one.
 */
typedef struct equipoise_options {
    uint64_t layout;
    /* Maximum age of returned states, from the cycle's due time, ns; 0: 25 ms. */
    uint64_t stale_after_ns;
    /* Number of states that are queued while the program is busy; 0: 8. 1 if only the newest is needed. */
    uint32_t depth;
    /* 1: do not publish the latency of received states. */
    uint32_t no_report;
} equipoise_options;

#define EQUIPOISE_OPTIONS_DEFAULT {EQUIPOISE_LAYOUT, 0, 0, 0}

/* Reader of one station. Only the thread that opened it may use it. */
typedef struct equipoise_consumer equipoise_consumer;

/* Joins a station as name (1 to 32 letters, digits, '-', '_'). The daemon need not run yet. *consumer is NULL unless
 * the outcome is EQUIPOISE_OK.
 */
int equipoise_open(const char *station, const char *name, const equipoise_options *options,
                   equipoise_consumer **consumer);

/* The oldest state not yet returned; sleeps until one arrives or timeout_ns has passed (a few milliseconds late at a
 * 250 Hz kernel tick). 0 does not sleep.
 */
int equipoise_next(equipoise_consumer *consumer, uint64_t timeout_ns, equipoise_reading *reading);

/* The newest state, without sleeping: for a program with its own cycle. It may have been returned before (is_new), but
 * is never older than stale_after_ns.
 */
int equipoise_latest(equipoise_consumer *consumer, equipoise_reading *reading);

/* The newest early state, without sleeping; it is at hand when equipoise_next returns the state of its cycle. Never older
 * than 40 ms, from its cycle's due time. The first call subscribes.
 */
int equipoise_early(equipoise_consumer *consumer, equipoise_early_reading *reading);

/* Leaves the station. The consumer must not be used again. NULL has no effect. */
int equipoise_close(equipoise_consumer *consumer);

/* Reason why the latency of received states is not published, for example because all publishers are in use; reading is
 * not affected. "" if it is published or disabled. Valid until the next call for this consumer. For NULL or another
 * thread's consumer: the message of equipoise_error().
 */
const char *equipoise_report_refusal(equipoise_consumer *consumer);

/* Message of this thread's last outcome other than EQUIPOISE_OK; "" before the first. Valid until the thread's next
 * call.
 */
const char *equipoise_error(void);

/* Public name of a bit of valid, such as "suit_stale" for bit 0; NULL for an undefined bit. */
const char *equipoise_reason_name(uint32_t bit);

#ifdef __cplusplus
}
#endif

#endif
