/* Reads the states of an Equipoise station, from C and C++.
 *
 *     cargo build --release -p equipoise-c
 *     cc -I clients/c controller.c -L target/release -lequipoise_c
 *
 * clients/c/controller.c is a whole program; docs/consumers/c.md says what to check before a value is used.
 *
 * Library and daemon must be of one release, and run as the same user. The directory of the bus is that of
 * EQUIPOISE_BUS_ROOT, as for the daemon.
 *
 * Written from clients/c/equipoise.h.in and the declarations in Rust: do not edit.
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

/* What a program is compiled with: fields of all structs, and all names and numbers. See equipoise_options. */
#define EQUIPOISE_STATE_TYPE "equipoise/State/5"
#define EQUIPOISE_LAYOUT UINT64_C(0xfa570fec8d8aa0d6)

/* Reasons why values of a state must not be used: bits of equipoise_state.valid. */
/* No suit sample for more than two sample periods. */
#define EQUIPOISE_REASON_SUIT_STALE (UINT64_C(1) << 0)
/* No ground sample for more than two sample periods. */
#define EQUIPOISE_REASON_GROUND_STALE (UINT64_C(1) << 1)
/* The worker's mass distribution is not identified yet. */
#define EQUIPOISE_REASON_NOT_IDENTIFIED (UINT64_C(1) << 2)
/* The worker moves faster than the equations in use allow. */
#define EQUIPOISE_REASON_MOVING (UINT64_C(1) << 3)
/* Too little force on the ground, or the feet are off the plate. */
#define EQUIPOISE_REASON_FEET_OFF_PLATE (UINT64_C(1) << 4)
/* The external force is too small to tell where it acts. */
#define EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD (UINT64_C(1) << 5)
/* The model was changed within the last second. */
#define EQUIPOISE_REASON_MODEL_CHANGED (UINT64_C(1) << 6)
/* Device time is not yet tied to host time. */
#define EQUIPOISE_REASON_CLOCK_UNSYNCHRONISED (UINT64_C(1) << 7)
/* The load found from the two centres of pressure is far from the hands. */
#define EQUIPOISE_REASON_LOAD_NOT_AT_HANDS (UINT64_C(1) << 8)
/* The worker's mass is neither configured nor measured yet. */
#define EQUIPOISE_REASON_MASS_UNKNOWN (UINT64_C(1) << 9)
/* The worker's bones are not known yet, and so no centre of mass. */
#define EQUIPOISE_REASON_BODY_UNKNOWN (UINT64_C(1) << 10)
/* The plate reports a fault. */
#define EQUIPOISE_REASON_PLATE_FAULT (UINT64_C(1) << 11)
/* The ground's devices tell no centre of pressure in the world, and where the feet stand is not known either. */
#define EQUIPOISE_REASON_COP_NOT_MEASURED (UINT64_C(1) << 12)
/* The external force is below the detection limit in quick motion, where a load is possible: it is unknown
   whether something is carried. */
#define EQUIPOISE_REASON_LOAD_BELOW_DETECTION_LIMIT (UINT64_C(1) << 13)
/* Where the worker stands on the plate is not known: the suit was restarted, or was silent for long. */
#define EQUIPOISE_REASON_POSITION_UNKNOWN (UINT64_C(1) << 14)
/* What the ground's devices show no body does, or no working device: a reading that leaps, repeats, or pulls. */
#define EQUIPOISE_REASON_GROUND_IMPLAUSIBLE (UINT64_C(1) << 15)
/* What the suit shows no body does, or no working suit: poses that repeat, leap, or come apart at the joints. */
#define EQUIPOISE_REASON_SUIT_IMPLAUSIBLE (UINT64_C(1) << 16)
/* The ground carries less than the body weighs: a foot off the plate, a hand that leans on something, or a
   device whose gain is another than before. */
#define EQUIPOISE_REASON_WEIGHT_MISSING (UINT64_C(1) << 17)

/* Sets of reasons that invalidate a value: no bit of its set may be raised. An invalid value is 0 and has no meaning. */
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
     EQUIPOISE_REASON_BODY_UNKNOWN | EQUIPOISE_REASON_POSITION_UNKNOWN | \
     EQUIPOISE_REASON_SUIT_IMPLAUSIBLE)
#define EQUIPOISE_INVALIDATES_DELTA_F \
    (EQUIPOISE_REASON_GROUND_STALE | EQUIPOISE_REASON_MOVING | \
     EQUIPOISE_REASON_FEET_OFF_PLATE | EQUIPOISE_REASON_MASS_UNKNOWN | \
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE)
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
     EQUIPOISE_REASON_PLATE_FAULT | EQUIPOISE_REASON_COP_NOT_MEASURED | \
     EQUIPOISE_REASON_GROUND_IMPLAUSIBLE | EQUIPOISE_REASON_SUIT_IMPLAUSIBLE | \
     EQUIPOISE_REASON_WEIGHT_MISSING)
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

enum equipoise_phase {
    EQUIPOISE_PHASE_WAITING = 0,
    EQUIPOISE_PHASE_IDENTIFYING = 1,
    EQUIPOISE_PHASE_MONITORING = 2,
    EQUIPOISE_PHASE_DEGRADED = 3
};

/* How close a torque is to the joint's limit. UNDECIDED: the torque's uncertainty covers two levels. */
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

/* What this station's sensors do not give: bits of equipoise_state.unavailable. Those values are 0 and mean nothing. */
/* suit_com_m: the suit does not send it (MVN type 24). */
#define EQUIPOISE_UNAVAILABLE_SUIT_COM (UINT32_C(1) << 0)
/* The horizontal part of ground_force_n: insoles feel only what presses on them. */
#define EQUIPOISE_UNAVAILABLE_SHEAR (UINT32_C(1) << 1)

/* What the ground's sample is made of: bits of equipoise_state.ground_devices. */
/* The force plate of [ground]. */
#define EQUIPOISE_GROUND_PLATE (UINT32_C(1) << 0)
/* The one of [ground.second]. */
#define EQUIPOISE_GROUND_SECOND_PLATE (UINT32_C(1) << 1)
/* Insoles. */
#define EQUIPOISE_GROUND_INSOLES (UINT32_C(1) << 2)

/* Where the worker's bones come from. */
enum equipoise_body_source {
    EQUIPOISE_BODY_SOURCE_UNKNOWN = 0,
    EQUIPOISE_BODY_SOURCE_POSES = 1,
    EQUIPOISE_BODY_SOURCE_NULL_POSE = 2,
    EQUIPOISE_BODY_SOURCE_STORED = 3
};

/* Why the suit's null pose is not used. */
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

/* Everything the station says, once per cycle. World: X forward, Y left, Z up, the station's origin.
 *
 * A value may be used only if no reason that spoils it is raised in valid. Nothing is ever NaN.
 */
typedef struct equipoise_state {
    /* The cycle's number in this daemon's life, from 1. */
    uint64_t cycle;
    /* When the cycle was due, CLOCK_MONOTONIC. */
    uint64_t time_ns;
    /* The suit sample that the values below belong to; 0 before the first. */
    uint64_t suit_sample_time_ns;
    /* Age of the newest suit sample at time_ns. */
    uint64_t suit_age_ns;
    /* Age of the newest ground sample at time_ns. */
    uint64_t ground_age_ns;
    /* How far suit_sample_time_ns lies behind the newest suit sample that was worked through. */
    uint64_t group_delay_ns;
    /* Reasons why values must not be used: EQUIPOISE_REASON_…. */
    uint64_t valid;
    /* An enum equipoise_phase. */
    uint32_t phase;
    /* 1 while the worker holds still (20-sample window). */
    uint32_t static_pose;
    /* 1 once the stop rule of the identification is met. */
    uint32_t converged;
    /* Held poses that entered the filter. */
    uint32_t poses_used;
    /* Grows by one with every step of the feet. */
    uint32_t stance;
    /* Index of the suggested pose in the library of poses; UINT32_MAX when none is asked for. */
    uint32_t suggested_pose;
    /* Suit samples in motion that entered the filter (method = "static+dynamic"). */
    uint32_t motion_samples_used;
    /* Where zeta comes from: an enum equipoise_sharing. */
    uint32_t sharing_source;
    /* Index of the joint that comes closest to its limit; UINT32_MAX while no torque is published. */
    uint32_t worst_joint;
    /* Lifts that entered the cumulative dose. */
    uint32_t lifts;
    /* Where the worker's bones come from: an enum equipoise_body_source. */
    uint32_t body_source;
    /* Where the outline of the soles comes from: an enum equipoise_foot_outline. */
    uint32_t foot_outline_source;
    /* Why the body dimensions that the suit sent last are not used: an enum equipoise_body_rejected. */
    uint32_t body_rejected;
    /* What this station's sensors do not give: EQUIPOISE_UNAVAILABLE_…. Those values are zero and mean nothing,
       whatever valid says. */
    uint32_t unavailable;
    /* Where the body's accelerations come from: an enum equipoise_acceleration. */
    uint32_t acceleration_source;
    /* What the ground's sample was made of: EQUIPOISE_GROUND_…. */
    uint32_t ground_devices;
    /* Overload level per joint: an enum equipoise_level. */
    uint32_t joint_level[EQUIPOISE_JOINTS];
    /* Measured centre of pressure, m. */
    double cop_measured_m[2];
    /* 1-σ of cop_measured_m, m. */
    double cop_measured_sigma_m[2];
    /* Centre of pressure that the unloaded body would have in this motion, by the identified model, m. */
    double cop_estimated_m[2];
    /* 1-σ of cop_estimated_m, m. */
    double cop_sigma_m[2];
    /* Estimated centre of mass of the unloaded body, m. */
    double com_m[3];
    /* The suit maker's own centre of mass, held to the floor as the segments are, m; see unavailable. */
    double suit_com_m[3];
    /* Ground reaction force on the person, N; see unavailable for its horizontal part. */
    double ground_force_n[3];
    /* External force carried: measured ground reaction less what the body alone needs in this motion, N. */
    double delta_f_n[3];
    /* 1-σ of the vertical delta_f_n, N. */
    double delta_f_sigma_n;
    /* Body mass in use, kg. */
    double mass_kg;
    /* Share of the ground reaction under the left and the right foot. */
    double zeta[2];
    /* Share of the load in the left and the right hand. */
    double eta[2];
    /* 1-σ of zeta: the two errors are equal and opposite. */
    double zeta_sigma;
    /* 1-σ of eta: the two errors are equal and opposite. */
    double eta_sigma;
    /* Horizontal distance from the load to the line between the hands, m. */
    double load_hand_distance_m;
    /* Mass in the hands, kg. */
    double lifted_mass_kg;
    /* 1-σ of lifted_mass_kg, kg. */
    double lifted_mass_sigma_kg;
    /* Horizontal distance from the middle of the ankles to the load, m. */
    double reach_m;
    /* 1-σ of reach_m, m. */
    double reach_sigma_m;
    /* Largest variance of an identified parameter, m² (the paper's P_jj). */
    double variance_max_m2;
    /* Predicted 1-σ of the CoP over the poses of the library, m. */
    double predicted_cop_sigma_m;
    /* Normalised innovation squared of the last pose (2 degrees of freedom); 0 before the first. */
    double nis;
    /* How much the prior's covariance was inflated because this worker did not fit it; 1 if not at all. */
    double prior_inflation;
    /* How far the worker is from the suggested pose: RMS joint angle, or the turn of the body that is still to
       be made, rad. */
    double pose_mismatch_rad;
    /* How much later than the ground's the suit's sample times are than they should be, s. */
    double suit_skew_s;
    /* 1-σ of suit_skew_s, s; 0 while the motion has not shown the skew. */
    double suit_skew_sigma_s;
    /* Net moment at L5/S1 of upper body and load about the horizontal axes, N m. */
    double l5s1_moment_nm;
    /* 1-σ of l5s1_moment_nm, N m. */
    double l5s1_moment_sigma_nm;
    /* Estimated compression of the L5/S1 disc, N. */
    double l5s1_compression_n;
    /* 1-σ of l5s1_compression_n, N. */
    double l5s1_compression_sigma_n;
    /* Cumulative damage of the low back after LiFFT (Gallagher 2017), 1 being failure. */
    double dose_damage;
    /* Probability of a high-risk job by that dose, in [0, 1]. */
    double dose_probability;
    /* Unit vector, world: where the load should move to relieve the worst joint; zero if nowhere. */
    double advice_direction[3];
    /* By how much that relieves it, N m per centimetre. */
    double advice_gain_nm_per_cm;
    /* Segment origins in the station's world, m. */
    double segment_origin_m[EQUIPOISE_SEGMENTS][3];
    /* Overload torque per joint (Eq. 15), world axes, N m. */
    double torque_nm[EQUIPOISE_JOINTS][3];
    /* 1-σ of each torque's magnitude, N m. */
    double torque_sigma_nm[EQUIPOISE_JOINTS];
    /* Covariance of the horizontal components of each torque, (N m)²: xx, xy, yy. The vertical component has no
       σ. */
    double torque_covariance_nm2[EQUIPOISE_JOINTS][3];
    /* τ_max of each joint for this worker, N m. */
    double torque_limit_nm[EQUIPOISE_JOINTS];
    /* Overloading fatigue of each joint, in [0, 1] (Lorenzini et al. 2019). */
    double fatigue[EQUIPOISE_JOINTS];
    /* When egress handed the state to the bus, CLOCK_MONOTONIC; 0 while the loop has it. The one field that a
       replay does not repeat. */
    uint64_t published_ns;
} equipoise_state;

/* A state that is current, with what a controller must know about it. Without one (any outcome but EQUIPOISE_OK) every
 * reason is raised in state.valid, and ages are UINT64_MAX: nothing of an earlier reading is left.
 */
typedef struct equipoise_reading {
    equipoise_state state;
    /* When it was picked up, CLOCK_MONOTONIC. */
    uint64_t received_ns;
    /* How long ago its cycle was due, when it was handed out. */
    uint64_t age_ns;
    /* How old the moment is that torques, forces and centres are about; UINT64_MAX before the first. */
    uint64_t sample_age_ns;
    /* States since the last new one that were not handed out: overwritten before they were read, or too old. */
    uint64_t missed;
    /* 1 if the daemon was restarted between the last new state and this one. */
    uint32_t restarted;
    /* 1 if it was not handed out before; equipoise_latest hands one out again. */
    uint32_t is_new;
} equipoise_reading;

enum equipoise_outcome {
    /* It was done. */
    EQUIPOISE_OK = 0,
    /* No new state came in time: the daemon is not running, or hangs. */
    EQUIPOISE_SILENT = 1,
    /* States came, but all too old to be handed out. */
    EQUIPOISE_STALE = 2,
    /* The daemon's CLOCK_MONOTONIC is another one: both must run in one time namespace. */
    EQUIPOISE_OTHER_CLOCK = 3,
    /* The bus cannot be joined or read. An open consumer rejoins by itself. */
    EQUIPOISE_BUS = 4,
    /* The call itself is wrong: a null pointer, another thread's consumer, another header. */
    EQUIPOISE_WRONG_USE = 5,
    /* A defect of this library. */
    EQUIPOISE_DEFECT = 6
};

/* How to read. Begin with EQUIPOISE_OPTIONS_DEFAULT: it says which header the program was compiled with, and another
 * one than the library's is refused.
 */
typedef struct equipoise_options {
    uint64_t layout;
    /* A state is handed out only while it is younger than this, counted from when its cycle was due; 0: 25 ms. */
    uint64_t stale_after_ns;
    /* States that wait while the program is busy; 0: 8. 1 for who only wants the newest. */
    uint32_t depth;
    /* 1: publish nothing about how late states come. */
    uint32_t no_report;
} equipoise_options;

#define EQUIPOISE_OPTIONS_DEFAULT {EQUIPOISE_LAYOUT, 0, 0, 0}

/* Reads one station. Belongs to the thread that opened it. */
typedef struct equipoise_consumer equipoise_consumer;

/* Joins a station as name (1 to 32 letters, digits, '-', '_'). The daemon need not run yet. *consumer is NULL unless
 * the outcome is EQUIPOISE_OK.
 */
int equipoise_open(const char *station, const char *name, const equipoise_options *options,
                   equipoise_consumer **consumer);

/* The next state not yet handed out, oldest first; sleeps until one comes or timeout_ns has passed, a few milliseconds
 * late at a 250 Hz kernel tick. 0 does not sleep.
 */
int equipoise_next(equipoise_consumer *consumer, uint64_t timeout_ns, equipoise_reading *reading);

/* The newest state there is, without sleeping: for who has a rhythm of its own. It may have been handed out before
 * (is_new), but is never older than stale_after_ns.
 */
int equipoise_latest(equipoise_consumer *consumer, equipoise_reading *reading);

/* Leaves the station. NULL is nothing to do; the consumer must not be used again. */
int equipoise_close(equipoise_consumer *consumer);

/* Why nothing is published about how late states come, though it should be: all places may be taken. Reading does not
 * suffer. "" if it is published, or was not asked for. Until the next call for this consumer. Of NULL or another thread's
 * consumer it is the sentence that says so, as equipoise_error() has it.
 */
const char *equipoise_report_refusal(equipoise_consumer *consumer);

/* The sentence of this thread's last outcome but EQUIPOISE_OK; "" before the first. Until the thread's next call. */
const char *equipoise_error(void);

/* The public name of a bit of valid, such as "suit_stale" for bit 0; NULL for a bit that has none. */
const char *equipoise_reason_name(uint32_t bit);

#ifdef __cplusplus
}
#endif

#endif
