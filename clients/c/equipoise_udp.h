/* The datagrams of an Equipoise station's UDP gateway, for any C compiler and any byte order.
 *
 *     cc -std=c11 -I clients/c your_program.c clients/c/udp_reader.c
 *
 * clients/c/udp_controller.c is a complete program; docs/consumers/udp.md lists the checks before a value is used.
 * Generated from the gateway's table: do not edit.
 *
 *     EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test wires
 */
#ifndef EQUIPOISE_UDP_H
#define EQUIPOISE_UDP_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define EQUIPOISE_UDP_MAGIC "EQPU"
#define EQUIPOISE_UDP_VERSION 2
#define EQUIPOISE_UDP_BYTES 920
#define EQUIPOISE_UDP_JOINTS 22

/* status: reason why there is no state. */
enum equipoise_udp_status {
    EQUIPOISE_UDP_STATUS_CURRENT = 0,
    EQUIPOISE_UDP_STATUS_SILENT = 1,
    EQUIPOISE_UDP_STATUS_STALE = 2,
    EQUIPOISE_UDP_STATUS_OTHER_CLOCK = 3,
    EQUIPOISE_UDP_STATUS_BUS = 4
};

/* phase */
enum equipoise_udp_phase {
    EQUIPOISE_UDP_PHASE_WAITING = 0,
    EQUIPOISE_UDP_PHASE_IDENTIFYING = 1,
    EQUIPOISE_UDP_PHASE_MONITORING = 2,
    EQUIPOISE_UDP_PHASE_DEGRADED = 3
};

/* joint_level. UNDECIDED: the uncertainty of the torque covers two levels; treat it as the highest. */
enum equipoise_udp_level {
    EQUIPOISE_UDP_LEVEL_NONE = 0,
    EQUIPOISE_UDP_LEVEL_GREEN = 1,
    EQUIPOISE_UDP_LEVEL_ORANGE = 2,
    EQUIPOISE_UDP_LEVEL_RED = 3,
    EQUIPOISE_UDP_LEVEL_ABOVE_MAX = 4,
    EQUIPOISE_UDP_LEVEL_UNDECIDED = 5
};

/* Bits of valid: invalid reasons. */
enum equipoise_udp_reason {
    EQUIPOISE_UDP_REASON_SUIT_STALE = 1,
    EQUIPOISE_UDP_REASON_GROUND_STALE = 2,
    EQUIPOISE_UDP_REASON_NOT_IDENTIFIED = 4,
    EQUIPOISE_UDP_REASON_MOVING = 8,
    EQUIPOISE_UDP_REASON_FEET_OFF_PLATE = 16,
    EQUIPOISE_UDP_REASON_BELOW_LOAD_THRESHOLD = 32,
    EQUIPOISE_UDP_REASON_MODEL_CHANGED = 64,
    EQUIPOISE_UDP_REASON_CLOCK_UNSYNCHRONISED = 128,
    EQUIPOISE_UDP_REASON_LOAD_NOT_AT_HANDS = 256,
    EQUIPOISE_UDP_REASON_MASS_UNKNOWN = 512,
    EQUIPOISE_UDP_REASON_BODY_UNKNOWN = 1024,
    EQUIPOISE_UDP_REASON_PLATE_FAULT = 2048,
    EQUIPOISE_UDP_REASON_COP_NOT_MEASURED = 4096,
    EQUIPOISE_UDP_REASON_LOAD_BELOW_DETECTION_LIMIT = 8192,
    EQUIPOISE_UDP_REASON_POSITION_UNKNOWN = 16384,
    EQUIPOISE_UDP_REASON_GROUND_IMPLAUSIBLE = 32768,
    EQUIPOISE_UDP_REASON_SUIT_IMPLAUSIBLE = 65536,
    EQUIPOISE_UDP_REASON_WEIGHT_MISSING = 131072
};

/* Bits of usable: groups of valid values. */
enum equipoise_udp_usable {
    EQUIPOISE_UDP_USABLE_GROUND_FORCE = 1,
    EQUIPOISE_UDP_USABLE_COP_MEASURED = 2,
    EQUIPOISE_UDP_USABLE_COM = 4,
    EQUIPOISE_UDP_USABLE_COP_ESTIMATED = 8,
    EQUIPOISE_UDP_USABLE_DELTA_F = 16,
    EQUIPOISE_UDP_USABLE_RESIDUAL = 32,
    EQUIPOISE_UDP_USABLE_LIFTED_MASS = 64,
    EQUIPOISE_UDP_USABLE_LOW_BACK = 128,
    EQUIPOISE_UDP_USABLE_TORQUES = 256
};

/* Indices of arrays per joint. */
enum equipoise_udp_joint {
    EQUIPOISE_UDP_JOINT_L5S1 = 0,
    EQUIPOISE_UDP_JOINT_L4L3 = 1,
    EQUIPOISE_UDP_JOINT_L1T12 = 2,
    EQUIPOISE_UDP_JOINT_T9T8 = 3,
    EQUIPOISE_UDP_JOINT_T1C7 = 4,
    EQUIPOISE_UDP_JOINT_C1_HEAD = 5,
    EQUIPOISE_UDP_JOINT_RIGHT_T4_SHOULDER = 6,
    EQUIPOISE_UDP_JOINT_RIGHT_SHOULDER = 7,
    EQUIPOISE_UDP_JOINT_RIGHT_ELBOW = 8,
    EQUIPOISE_UDP_JOINT_RIGHT_WRIST = 9,
    EQUIPOISE_UDP_JOINT_LEFT_T4_SHOULDER = 10,
    EQUIPOISE_UDP_JOINT_LEFT_SHOULDER = 11,
    EQUIPOISE_UDP_JOINT_LEFT_ELBOW = 12,
    EQUIPOISE_UDP_JOINT_LEFT_WRIST = 13,
    EQUIPOISE_UDP_JOINT_RIGHT_HIP = 14,
    EQUIPOISE_UDP_JOINT_RIGHT_KNEE = 15,
    EQUIPOISE_UDP_JOINT_RIGHT_ANKLE = 16,
    EQUIPOISE_UDP_JOINT_RIGHT_BALL_FOOT = 17,
    EQUIPOISE_UDP_JOINT_LEFT_HIP = 18,
    EQUIPOISE_UDP_JOINT_LEFT_KNEE = 19,
    EQUIPOISE_UDP_JOINT_LEFT_ANKLE = 20,
    EQUIPOISE_UDP_JOINT_LEFT_BALL_FOOT = 21
};

/* A datagram, in this machine's byte order. A value of a group is 0 while the group's bit of usable is 0. */
typedef struct equipoise_udp_datagram {
    /* EQPU. */
    char magic[5];
    /* Number of this table: 2. */
    uint16_t version;
    /* Of the whole datagram [bytes]. */
    uint16_t length;
    /* Name of the station, padded with zeros. */
    char station[33];
    /* Start of the sender since 1970 (UTC): sequence restarts from 1 with a later one [ns]. */
    uint64_t session_ns;
    /* Number of the datagram in the session, from 1; the same for all receivers. */
    uint64_t sequence;
    /* 0: there is a current state. Otherwise the reason why there is none: 1 silent, 2 stale, 3 other_clock, 4 bus. */
    uint32_t status;
    /* 0 waiting, 1 identifying, 2 monitoring, 3 degraded. */
    uint32_t phase;
    /* Silent: duration; stale: age of the newest state; other_clock: lead of its clock; otherwise 0 [ns]. */
    uint64_t status_ns;
    /* Number of the cycle since the daemon's start, from 1. */
    uint64_t cycle;
    /* Due time of the cycle, the station's CLOCK_MONOTONIC [ns]. */
    uint64_t state_time_ns;
    /* Sample time that torques, forces and centres refer to, same clock; 0 before the first [ns]. */
    uint64_t sample_time_ns;
    /* Age of the state at sending; all ones without a state [ns]. */
    uint64_t age_ns;
    /* Age of sample_time_ns at sending; all ones before the first [ns]. */
    uint64_t sample_age_ns;
    /* Age of the newest suit sample at state_time_ns; all ones: no sample [ns]. */
    uint64_t suit_age_ns;
    /* Age of the newest ground sample at state_time_ns; all ones: no sample [ns]. */
    uint64_t ground_age_ns;
    /* Invalid reasons (below); all ones without a state [bits]. */
    uint64_t valid;
    /* Groups of valid values (below); 0 without a state [bits]. */
    uint32_t usable;
    /* Quantities that the station's sensors do not provide: 1 suit_com, 2 shear [bits]. */
    uint32_t unavailable;
    /* Sum of: 1 new state; 4 static pose; 8 identified [bits]. */
    uint32_t flags;
    /* Joint closest to its limit; all ones while torques are invalid [joint]. */
    uint32_t worst_joint;
    /* Number of lifts in the dose. */
    uint32_t lifts;
    /* 0 none, 1 green, 2 orange, 3 red, 4 above_max, 5 undecided: treat it as the highest. Needs TORQUES */
    uint8_t joint_level[22];
    /* Number of daemon starts that the sender has detected in this session; 0: none yet. Another number or another session: the daemon was restarted. */
    uint16_t daemon_life;
    /* Magnitude of the overload torque of each joint [N m]. Needs TORQUES */
    float torque_magnitude_nm[22];
    /* Overload torque of each joint, world axes [N m]. Needs TORQUES */
    float torque_nm[22][3];
    /* 1-σ of torque_magnitude_nm [N m]. Needs TORQUES */
    float torque_sigma_nm[22];
    /* τ_max of each joint for this worker [N m]. Needs TORQUES */
    float torque_limit_nm[22];
    /* Overloading fatigue of each joint [0 to 1]. */
    float fatigue[22];
    /* Mass in the hands [kg]. Needs LIFTED_MASS */
    float lifted_mass_kg;
    /* 1-σ of the value above [kg]. Needs LIFTED_MASS */
    float lifted_mass_sigma_kg;
    /* Horizontal distance of the load from the line between the hands [m]. Needs TORQUES */
    float load_hand_distance_m;
    /* Horizontal distance of the load from the midpoint of the ankles [m]. Needs TORQUES */
    float reach_m;
    /* η: fraction of the load in the left and the right hand [0 to 1]. Needs TORQUES */
    float hand_load_fraction[2];
    /* Direction in which a motion of the load relieves the worst joint, unit vector, world axes; zero if none does [1]. Needs TORQUES */
    float advice_direction[3];
    /* Reduction of its torque by a motion in that direction [N m/cm]. Needs TORQUES */
    float advice_gain_nm_per_cm;
    /* External force, world axes; x and y always 0, not published [N]. Needs DELTA_F */
    float delta_f_n[3];
    /* 1-σ of its vertical component [N]. Needs DELTA_F */
    float delta_f_sigma_n;
    /* Ground reaction on the person, world axes; x and y are 0 where unavailable has shear [N]. Needs GROUND_FORCE */
    float ground_force_n[3];
    /* Measured centre of pressure, world x and y [m]. Needs COP_MEASURED */
    float cop_measured_m[2];
    /* Centre of pressure of the same motion without the load, world x and y [m]. Needs COP_ESTIMATED */
    float cop_estimated_m[2];
    /* Estimated centre of mass of the unloaded body, world [m]. Needs COM */
    float com_m[3];
    /* Net moment at L5/S1 about the horizontal axes [N m]. Needs LOW_BACK */
    float l5s1_moment_nm;
    /* 1-σ of the value above [N m]. Needs LOW_BACK */
    float l5s1_moment_sigma_nm;
    /* Estimated compression of the L5/S1 disc [N]. Needs LOW_BACK */
    float l5s1_compression_n;
    /* 1-σ of the value above [N]. Needs LOW_BACK */
    float l5s1_compression_sigma_n;
    /* Cumulative damage of the low back, 1 at failure [1]. */
    float dose_damage;
    /* Probability of a high-risk job at this dose [0 to 1]. */
    float dose_probability;
    /* CRC-32 (ISO-HDLC: Ethernet's, zlib's) of all bytes before it. */
    uint32_t crc32;
} equipoise_udp_datagram;

/* X(type, name, number of elements, offset) for each field. */
#define EQUIPOISE_UDP_FIELDS(X) \
    X(char, magic, 4, 0) \
    X(u16, version, 1, 4) \
    X(u16, length, 1, 6) \
    X(char, station, 32, 8) \
    X(u64, session_ns, 1, 40) \
    X(u64, sequence, 1, 48) \
    X(u32, status, 1, 56) \
    X(u32, phase, 1, 60) \
    X(u64, status_ns, 1, 64) \
    X(u64, cycle, 1, 72) \
    X(u64, state_time_ns, 1, 80) \
    X(u64, sample_time_ns, 1, 88) \
    X(u64, age_ns, 1, 96) \
    X(u64, sample_age_ns, 1, 104) \
    X(u64, suit_age_ns, 1, 112) \
    X(u64, ground_age_ns, 1, 120) \
    X(u64, valid, 1, 128) \
    X(u32, usable, 1, 136) \
    X(u32, unavailable, 1, 140) \
    X(u32, flags, 1, 144) \
    X(u32, worst_joint, 1, 148) \
    X(u32, lifts, 1, 152) \
    X(u8, joint_level, 22, 156) \
    X(u16, daemon_life, 1, 178) \
    X(f32, torque_magnitude_nm, 22, 180) \
    X(f32, torque_nm, 66, 268) \
    X(f32, torque_sigma_nm, 22, 532) \
    X(f32, torque_limit_nm, 22, 620) \
    X(f32, fatigue, 22, 708) \
    X(f32, lifted_mass_kg, 1, 796) \
    X(f32, lifted_mass_sigma_kg, 1, 800) \
    X(f32, load_hand_distance_m, 1, 804) \
    X(f32, reach_m, 1, 808) \
    X(f32, hand_load_fraction, 2, 812) \
    X(f32, advice_direction, 3, 820) \
    X(f32, advice_gain_nm_per_cm, 1, 832) \
    X(f32, delta_f_n, 3, 836) \
    X(f32, delta_f_sigma_n, 1, 848) \
    X(f32, ground_force_n, 3, 852) \
    X(f32, cop_measured_m, 2, 864) \
    X(f32, cop_estimated_m, 2, 872) \
    X(f32, com_m, 3, 880) \
    X(f32, l5s1_moment_nm, 1, 892) \
    X(f32, l5s1_moment_sigma_nm, 1, 896) \
    X(f32, l5s1_compression_n, 1, 900) \
    X(f32, l5s1_compression_sigma_n, 1, 904) \
    X(f32, dose_damage, 1, 908) \
    X(f32, dose_probability, 1, 912) \
    X(u32, crc32, 1, 916)

/* Result of equipoise_udp_take. Only EQUIPOISE_UDP_TAKEN fills *datagram. */
enum equipoise_udp_outcome {
    EQUIPOISE_UDP_TAKEN = 0,
    /* Too short, or another length than that of its header or of this version. */
    EQUIPOISE_UDP_LENGTH = 1,
    /* It does not begin with EQPU. */
    EQUIPOISE_UDP_MAGIC_WRONG = 2,
    /* The datagram has another version than this header. */
    EQUIPOISE_UDP_OTHER_VERSION = 3,
    EQUIPOISE_UDP_CRC_WRONG = 4,
    EQUIPOISE_UDP_OTHER_STATION = 5,
    /* Not later than an accepted one: repeated, out of order, or of an earlier session. */
    EQUIPOISE_UDP_OLD = 6
};

/* Accepts the datagrams of one station, each once and in order. */
typedef struct equipoise_udp_reader {
    /* NULL: any station. */
    const char *station;
    uint64_t session_ns;
    uint64_t sequence;
    /* Time at which the last one was accepted, by the caller's clock, ns; 0: none yet. */
    uint64_t taken_at_ns;
    /* Datagrams accepted, and datagrams missing between them. */
    uint64_t taken;
    uint64_t missed;
    /* Datagrams rejected, by outcome. */
    uint64_t refused[7];
    /* Delay of the last datagram in addition to that of the fastest one of the session, including its time in the socket,
     * ns. equipoise_udp_age_ns adds it; add it to sample_age_ns, too.
     */
    uint64_t late_ns;
    /* Internal: time of the last empty socket, and bounds of the difference of this clock from the station's. */
    uint64_t drained_at_ns;
    uint64_t bounded_at_ns;
    int64_t ahead_min_ns;
    int64_t ahead_max_ns;
    int bounded;
} equipoise_udp_reader;

/* Initialises a reader. station may be NULL; the text must exist as long as the reader. */
void equipoise_udp_begin(equipoise_udp_reader *reader, const char *station);

/* Reports that the socket was empty at now_ns: read the clock, receive without waiting, and call this if there was no
 * datagram. The next datagram arrived later than that, which limits its time in the socket. Before the first call the age
 * of every state is that of the clock.
 */
void equipoise_udp_drained(equipoise_udp_reader *reader, uint64_t now_ns);

/* Validates a datagram; now_ns is the caller's clock, which must be monotonic (CLOCK_MONOTONIC). After a second without a
 * datagram any session is accepted, because the sender's wall clock may have been set back.
 *
 * Empty the socket before acting: the last datagram is the newest.
 */
int equipoise_udp_take(equipoise_udp_reader *reader, const void *bytes, size_t length, uint64_t now_ns,
                       equipoise_udp_datagram *datagram);

/* Present age of the last datagram's state, ns: its age when it was sent, late_ns, and the time since its receipt; without
 * the travel time of the fastest datagram. UINT64_MAX without a state or before the first datagram. Compare it with the
 * maximum age that your robot tolerates.
 */
uint64_t equipoise_udp_age_ns(const equipoise_udp_reader *reader, const equipoise_udp_datagram *datagram,
                              uint64_t now_ns);

/* "taken", "length", "magic", "version", "crc", "station", "old". */
const char *equipoise_udp_outcome_name(int outcome);

#ifdef __cplusplus
}
#endif

#endif
