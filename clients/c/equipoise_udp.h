/* The datagrams of an Equipoise station's UDP gateway, for any C compiler and any byte order.
 *
 *     cc -std=c11 -I clients/c your_program.c clients/c/udp_reader.c
 *
 * clients/c/udp_controller.c is a whole program; docs/consumers/udp.md says what to check before a value is used.
 * Written from the table of the gateway: do not edit.
 *
 *     EQUIPOISE_WRITE=1 cargo test -p equipoise-gateways --test udp
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

/* Why there is no state: status. */
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

/* joint_level. UNDECIDED: the torque's uncertainty covers two levels. Treat it as the worst. */
enum equipoise_udp_level {
    EQUIPOISE_UDP_LEVEL_NONE = 0,
    EQUIPOISE_UDP_LEVEL_GREEN = 1,
    EQUIPOISE_UDP_LEVEL_ORANGE = 2,
    EQUIPOISE_UDP_LEVEL_RED = 3,
    EQUIPOISE_UDP_LEVEL_ABOVE_MAX = 4,
    EQUIPOISE_UDP_LEVEL_UNDECIDED = 5
};

/* Bits of valid: why values are withheld. */
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

/* Bits of usable: which groups of values may be used. */
enum equipoise_udp_usable {
    EQUIPOISE_UDP_USABLE_GROUND_FORCE = 1,
    EQUIPOISE_UDP_USABLE_COP_MEASURED = 2,
    EQUIPOISE_UDP_USABLE_COM = 4,
    EQUIPOISE_UDP_USABLE_COP_ESTIMATED = 8,
    EQUIPOISE_UDP_USABLE_DELTA_F = 16,
    EQUIPOISE_UDP_USABLE_RESIDUAL = 32,
    EQUIPOISE_UDP_USABLE_LIFTED_MASS = 64,
    EQUIPOISE_UDP_USABLE_BACK = 128,
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

/* A datagram, in this machine's byte order. A value that needs a group is 0 while usable lacks its bit. */
typedef struct equipoise_udp_datagram {
    /* EQPU. */
    char magic[5];
    /* Number of this table: 2. */
    uint16_t version;
    /* Of the whole datagram [bytes]. */
    uint16_t length;
    /* Name of the station, filled up with zeros. */
    char station[33];
    /* When the sender started, since 1970 (UTC): a later one counts from 1 again [ns]. */
    uint64_t session_ns;
    /* Number of the datagram in the session, from 1; the same for all receivers. */
    uint64_t sequence;
    /* 0: a state follows. Else there is none, and why: 1 silent, 2 stale, 3 other_clock, 4 bus. */
    uint32_t status;
    /* 0 waiting, 1 identifying, 2 monitoring, 3 degraded. */
    uint32_t phase;
    /* Silent: for how long; stale: age of the newest state; other_clock: how far it is ahead; else 0 [ns]. */
    uint64_t status_ns;
    /* Number of the cycle in the daemon's life, from 1. */
    uint64_t cycle;
    /* When the cycle was due, the station's CLOCK_MONOTONIC [ns]. */
    uint64_t state_time_ns;
    /* The moment that torques, forces and centres are about, same clock; 0 before the first [ns]. */
    uint64_t sample_time_ns;
    /* Age of the state when it was sent; all ones without one [ns]. */
    uint64_t age_ns;
    /* Age of the moment when it was sent; all ones before the first [ns]. */
    uint64_t sample_age_ns;
    /* Age of the newest suit sample at state_time_ns; all ones: none came [ns]. */
    uint64_t suit_age_ns;
    /* Age of the newest ground sample at state_time_ns; all ones: none came [ns]. */
    uint64_t ground_age_ns;
    /* Reasons why values are withheld (below); all ones without a state [bits]. */
    uint64_t valid;
    /* Groups of values that may be used (below); 0 without a state [bits]. */
    uint32_t usable;
    /* What the station's sensors never give: 1 suit_com, 2 shear [bits]. */
    uint32_t unavailable;
    /* Values, added up: 1 not sent before; 4 the worker holds still; 8 identified [bits]. */
    uint32_t flags;
    /* The joint closest to its limit; all ones while torques are withheld [joint]. */
    uint32_t worst_joint;
    /* Lifts that entered the dose. */
    uint32_t lifts;
    /* 0 none, 1 green, 2 orange, 3 red, 4 above_max, 5 undecided: treat it as the worst. Needs TORQUES */
    uint8_t joint_level[22];
    /* How many daemons the sender heard in this session, of which this one is the last; 0: none yet. Another number, or another session, is another daemon's life. */
    uint16_t daemon_life;
    /* Overload torque of each joint: length of torque_nm [N m]. Needs TORQUES */
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
    /* 1-σ of it [kg]. Needs LIFTED_MASS */
    float lifted_mass_sigma_kg;
    /* Horizontal, from the load to the line between the hands [m]. Needs TORQUES */
    float load_hand_distance_m;
    /* Horizontal, from the middle of the ankles to the load [m]. Needs TORQUES */
    float reach_m;
    /* Of the load in the left and the right hand [share]. Needs TORQUES */
    float eta[2];
    /* Where the load should move to relieve the worst joint, world axes; zero if nowhere [1]. Needs TORQUES */
    float advice_direction[3];
    /* By how much that relieves it [N m/cm]. Needs TORQUES */
    float advice_gain_nm_per_cm;
    /* External force carried, world axes [N]. Needs DELTA_F */
    float delta_f_n[3];
    /* 1-σ of its vertical part [N]. Needs DELTA_F */
    float delta_f_sigma_n;
    /* Ground reaction on the person, world axes; x and y are 0 where unavailable has shear [N]. Needs GROUND_FORCE */
    float ground_force_n[3];
    /* Measured centre of pressure, world x and y [m]. Needs COP_MEASURED */
    float cop_measured_m[2];
    /* The one that the unloaded body would have [m]. Needs COP_ESTIMATED */
    float cop_estimated_m[2];
    /* Estimated centre of mass of the unloaded body [m]. Needs COM */
    float com_m[3];
    /* Net moment at L5/S1 [N m]. Needs BACK */
    float l5s1_moment_nm;
    /* 1-σ of it [N m]. Needs BACK */
    float l5s1_moment_sigma_nm;
    /* Estimated compression of the L5/S1 disc [N]. Needs BACK */
    float l5s1_compression_n;
    /* 1-σ of it [N]. Needs BACK */
    float l5s1_compression_sigma_n;
    /* Cumulative damage of the low back, 1 being failure [1]. */
    float dose_damage;
    /* Probability of a high-risk job by that dose [0 to 1]. */
    float dose_probability;
    /* CRC-32 (ISO-HDLC: Ethernet's, zlib's) of all bytes before it. */
    uint32_t crc32;
} equipoise_udp_datagram;

/* X(type of the number, name, how many, offset) for each field. */
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
    X(f32, eta, 2, 812) \
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

/* What became of a datagram. Only EQUIPOISE_UDP_TAKEN fills in *datagram. */
enum equipoise_udp_outcome {
    EQUIPOISE_UDP_TAKEN = 0,
    /* Too short, longer than it says, or not as long as this version is. */
    EQUIPOISE_UDP_LENGTH = 1,
    /* It does not begin with EQPU. */
    EQUIPOISE_UDP_MAGIC_WRONG = 2,
    /* Another version of the table than this header's. */
    EQUIPOISE_UDP_OTHER_VERSION = 3,
    EQUIPOISE_UDP_CRC_WRONG = 4,
    EQUIPOISE_UDP_OTHER_STATION = 5,
    /* Not later than one that was taken: repeated, overtaken, or of an earlier session. */
    EQUIPOISE_UDP_OLD = 6
};

/* Takes the datagrams of one station, each once and in order. */
typedef struct equipoise_udp_reader {
    /* NULL: any station. */
    const char *station;
    uint64_t session_ns;
    uint64_t sequence;
    /* When the last one was taken, by the caller's clock; 0: none yet. */
    uint64_t taken_at_ns;
    /* Datagrams taken, and those between them that never came. */
    uint64_t taken;
    uint64_t missed;
    /* Refused, by outcome. */
    uint64_t refused[7];
    /* How much longer than the fastest of the session the last one was under way, the time included that it waited in the
     * socket. equipoise_udp_age_ns adds it; add it to sample_age_ns, too.
     */
    uint64_t late_ns;
    /* The reader's own: when the socket was empty last, and between what bounds this clock is ahead of the station's. */
    uint64_t drained_at_ns;
    uint64_t bounded_at_ns;
    int64_t ahead_min_ns;
    int64_t ahead_max_ns;
    int bounded;
} equipoise_udp_reader;

/* station may be NULL. The text must live as long as the reader. */
void equipoise_udp_begin(equipoise_udp_reader *reader, const char *station);

/* The socket was empty at now_ns: read the clock, receive without waiting, and say so if there was nothing. What is taken
 * next came after that, so it is known how long it may have waited. Until this is said for the first time, every state is as
 * old as the clock.
 */
void equipoise_udp_drained(equipoise_udp_reader *reader, uint64_t now_ns);

/* Looks at a datagram; now_ns is the caller's clock, which must never go back (CLOCK_MONOTONIC). After a second without a
 * datagram any session is taken, in case the sender's wall clock was put back.
 *
 * Take all that waits in the socket before you act: the last one taken is the newest, and what lies in front of it is past.
 */
int equipoise_udp_take(equipoise_udp_reader *reader, const void *bytes, size_t length, uint64_t now_ns,
                       equipoise_udp_datagram *datagram);

/* How old the state of the last datagram that was taken is now: its age when it was sent, what it was late, and the time
 * since; only the time that the fastest was under way is not in it. UINT64_MAX if it had no state, or nothing was taken yet.
 * Compare it with the longest that your robot may go on without news.
 */
uint64_t equipoise_udp_age_ns(const equipoise_udp_reader *reader, const equipoise_udp_datagram *datagram,
                              uint64_t now_ns);

/* "taken", "length", "magic", "version", "crc", "station", "old". */
const char *equipoise_udp_outcome_name(int outcome);

#ifdef __cplusplus
}
#endif

#endif
