// Reads the states of an Equipoise station, from C++17: the C interface (clients/c/equipoise.h) with owners and types.
//
//     cargo build --release -p equipoise-c
//     c++ -std=c++17 -I clients/c -I clients/cpp controller.cpp -L target/release -lequipoise_c
//
// clients/cpp/controller.cpp is a complete program; docs/consumers/cpp.md lists the checks before a value is used.
// The constructor of Consumer throws Error. Later only std::bad_variant_access is thrown, if a Reading does not contain the
// requested alternative: `*` and `->` without a state, reason() with one. Nothing allocates after the constructor.
#ifndef EQUIPOISE_HPP
#define EQUIPOISE_HPP

#include "equipoise.h"

#include <chrono>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

namespace equipoise {

inline constexpr std::size_t joints = EQUIPOISE_JOINTS;

// Three components along the station's axes: X forward, Y left, Z up.
struct Vector3 {
    double x, y, z;

    double length() const noexcept { return std::sqrt(x * x + y * y + z * z); }
};

// A value with its standard deviation, both in the unit of the function's name.
struct WithSigma {
    double value, sigma;
};

enum class Joint : std::size_t {
    l5s1 = EQUIPOISE_JOINT_L5S1,
    l4l3 = EQUIPOISE_JOINT_L4L3,
    l1t12 = EQUIPOISE_JOINT_L1T12,
    t9t8 = EQUIPOISE_JOINT_T9T8,
    t1c7 = EQUIPOISE_JOINT_T1C7,
    c1_head = EQUIPOISE_JOINT_C1_HEAD,
    right_t4_shoulder = EQUIPOISE_JOINT_RIGHT_T4_SHOULDER,
    right_shoulder = EQUIPOISE_JOINT_RIGHT_SHOULDER,
    right_elbow = EQUIPOISE_JOINT_RIGHT_ELBOW,
    right_wrist = EQUIPOISE_JOINT_RIGHT_WRIST,
    left_t4_shoulder = EQUIPOISE_JOINT_LEFT_T4_SHOULDER,
    left_shoulder = EQUIPOISE_JOINT_LEFT_SHOULDER,
    left_elbow = EQUIPOISE_JOINT_LEFT_ELBOW,
    left_wrist = EQUIPOISE_JOINT_LEFT_WRIST,
    right_hip = EQUIPOISE_JOINT_RIGHT_HIP,
    right_knee = EQUIPOISE_JOINT_RIGHT_KNEE,
    right_ankle = EQUIPOISE_JOINT_RIGHT_ANKLE,
    right_ball_foot = EQUIPOISE_JOINT_RIGHT_BALL_FOOT,
    left_hip = EQUIPOISE_JOINT_LEFT_HIP,
    left_knee = EQUIPOISE_JOINT_LEFT_KNEE,
    left_ankle = EQUIPOISE_JOINT_LEFT_ANKLE,
    left_ball_foot = EQUIPOISE_JOINT_LEFT_BALL_FOOT,
};

// Overload level of a joint. undecided is the highest number: treat it as the highest level.
enum class Level : std::uint32_t {
    none = EQUIPOISE_LEVEL_NONE,
    green = EQUIPOISE_LEVEL_GREEN,
    orange = EQUIPOISE_LEVEL_ORANGE,
    red = EQUIPOISE_LEVEL_RED,
    above_max = EQUIPOISE_LEVEL_ABOVE_MAX,
    undecided = EQUIPOISE_LEVEL_UNDECIDED,
};

// A current state. Invalid values are nullopt; only raw() gives access to them.
class State {
public:
    explicit State(const equipoise_reading &reading) noexcept : reading_(reading) {}

    // All fields, as in the C interface; check `valid` before using a value.
    const equipoise_reading &raw() const noexcept { return reading_; }

    std::uint64_t cycle() const noexcept { return reading_.state.cycle; }
    std::chrono::nanoseconds age() const noexcept { return nanoseconds(reading_.age_ns); }
    // Age of the sample time that torques, forces and centres refer to; nullopt before the first sample.
    std::optional<std::chrono::nanoseconds> sample_age() const noexcept {
        if (reading_.sample_age_ns == UINT64_MAX) {
            return std::nullopt;
        }
        return nanoseconds(reading_.sample_age_ns);
    }
    // States since the last one that were not returned.
    std::uint64_t missed() const noexcept { return reading_.missed; }
    // The daemon was restarted since the last state: the subject may be another one, or not identified yet.
    bool restarted() const noexcept { return reading_.restarted != 0; }
    bool is_new() const noexcept { return reading_.is_new != 0; }

    // Invalid reasons: EQUIPOISE_REASON_….
    std::uint64_t reasons() const noexcept { return reading_.state.valid; }
    // No load, and all other values are valid.
    bool is_unloaded() const noexcept { return reasons() == EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD; }

    std::optional<Vector3> torque_nm(Joint joint) const noexcept {
        return unless(EQUIPOISE_INVALIDATES_TORQUES, vector(reading_.state.torque_nm[index(joint)]));
    }
    // Magnitude and its 1-σ.
    std::optional<WithSigma> torque_magnitude_nm(Joint joint) const noexcept {
        const double length_nm = vector(reading_.state.torque_nm[index(joint)]).length();
        return unless(EQUIPOISE_INVALIDATES_TORQUES, WithSigma{length_nm, reading_.state.torque_sigma_nm[index(joint)]});
    }
    std::optional<double> torque_limit_nm(Joint joint) const noexcept {
        return unless(EQUIPOISE_INVALIDATES_TORQUES, reading_.state.torque_limit_nm[index(joint)]);
    }
    std::optional<Level> level(Joint joint) const noexcept {
        return unless(EQUIPOISE_INVALIDATES_TORQUES, static_cast<Level>(reading_.state.joint_level[index(joint)]));
    }
    // Highest level of all joints.
    std::optional<Level> worst_level() const noexcept {
        std::uint32_t worst = EQUIPOISE_LEVEL_NONE;
        for (const std::uint32_t level : reading_.state.joint_level) {
            worst = level > worst ? level : worst;
        }
        return unless(EQUIPOISE_INVALIDATES_TORQUES, static_cast<Level>(worst));
    }
    // Joint closest to its torque limit.
    std::optional<Joint> worst_joint() const noexcept {
        if (reading_.state.worst_joint >= joints) {
            return std::nullopt;
        }
        return unless(EQUIPOISE_INVALIDATES_TORQUES, static_cast<Joint>(reading_.state.worst_joint));
    }
    // 0 to 1; always valid.
    double fatigue(Joint joint) const noexcept { return reading_.state.fatigue[index(joint)]; }

    std::optional<WithSigma> lifted_mass_kg() const noexcept {
        return unless(EQUIPOISE_INVALIDATES_LIFTED_MASS,
                      WithSigma{reading_.state.lifted_mass_kg, reading_.state.lifted_mass_sigma_kg});
    }
    // Horizontal distance of the load from the midpoint of the ankles.
    std::optional<double> reach_m() const noexcept {
        return unless(EQUIPOISE_INVALIDATES_TORQUES, reading_.state.reach_m);
    }
    // External force, world axes.
    std::optional<Vector3> delta_f_n() const noexcept {
        return unless(EQUIPOISE_INVALIDATES_DELTA_F, vector(reading_.state.delta_f_n));
    }
    // Vertical component; available without shear, too.
    std::optional<double> ground_force_up_n() const noexcept {
        return unless(EQUIPOISE_INVALIDATES_GROUND_FORCE, reading_.state.ground_force_n[2]);
    }
    std::optional<WithSigma> l5s1_compression_n() const noexcept {
        return unless(EQUIPOISE_INVALIDATES_LOW_BACK,
                      WithSigma{reading_.state.l5s1_compression_n, reading_.state.l5s1_compression_sigma_n});
    }
    // Direction in which a motion of the load relieves the worst joint, unit vector, world axes; nullopt if none does.
    std::optional<Vector3> advice_direction() const noexcept {
        const Vector3 direction = vector(reading_.state.advice_direction);
        return direction.length() > 0.0 ? unless(EQUIPOISE_INVALIDATES_TORQUES, direction) : std::nullopt;
    }

private:
    static std::chrono::nanoseconds nanoseconds(std::uint64_t count) noexcept {
        return std::chrono::nanoseconds(static_cast<std::chrono::nanoseconds::rep>(count));
    }
    static std::size_t index(Joint joint) noexcept { return static_cast<std::size_t>(joint); }
    static Vector3 vector(const double (&components)[3]) noexcept {
        return {components[0], components[1], components[2]};
    }
    template <typename Value> std::optional<Value> unless(std::uint64_t invalidating, Value value) const noexcept {
        return (reasons() & invalidating) == 0 ? std::optional<Value>(value) : std::nullopt;
    }

    equipoise_reading reading_;
};

// A current early state: the result about the newest suit sample. Invalid values are nullopt.
class EarlyState {
public:
    explicit EarlyState(const equipoise_early_reading &reading) noexcept : reading_(reading) {}

    // All fields, as in the C interface; check `valid` before using a value.
    const equipoise_early_reading &raw() const noexcept { return reading_; }

    // Age of the sample that the results refer to.
    std::chrono::nanoseconds sample_age() const noexcept {
        return std::chrono::nanoseconds(static_cast<std::chrono::nanoseconds::rep>(reading_.sample_age_ns));
    }
    bool is_new() const noexcept { return reading_.is_new != 0; }
    // Invalid reasons: EQUIPOISE_REASON_….
    std::uint64_t reasons() const noexcept { return reading_.early.valid; }

    std::optional<Vector3> torque_nm(Joint joint) const noexcept {
        const double(&torque)[3] = reading_.early.torque_nm[static_cast<std::size_t>(joint)];
        return unless(EQUIPOISE_INVALIDATES_TORQUES, Vector3{torque[0], torque[1], torque[2]});
    }
    // Magnitude and its 1-σ.
    std::optional<WithSigma> torque_magnitude_nm(Joint joint) const noexcept {
        const auto torque = torque_nm(joint);
        const double sigma_nm = reading_.early.torque_sigma_nm[static_cast<std::size_t>(joint)];
        return torque ? std::optional<WithSigma>(WithSigma{torque->length(), sigma_nm}) : std::nullopt;
    }
    // Grip of the left (0) or right (1) hand, and its velocity.
    std::optional<Vector3> hand_m(std::size_t side) const noexcept {
        const double(&at)[3] = reading_.early.hand_m[side & 1U];
        return unless(EQUIPOISE_INVALIDATES_COM, Vector3{at[0], at[1], at[2]});
    }
    std::optional<Vector3> hand_velocity_m_per_s(std::size_t side) const noexcept {
        const double(&velocity)[3] = reading_.early.hand_velocity_m_per_s[side & 1U];
        return unless(EQUIPOISE_INVALIDATES_COP_ESTIMATED, Vector3{velocity[0], velocity[1], velocity[2]});
    }

private:
    template <typename Value> std::optional<Value> unless(std::uint64_t invalidating, Value value) const noexcept {
        return (reasons() & invalidating) == 0 ? std::optional<Value>(value) : std::nullopt;
    }

    equipoise_early_reading reading_;
};

// Reason why there is no current state.
enum class NoStateReason {
    silent = EQUIPOISE_SILENT,           // No new state arrived in time: the daemon is not running, or hangs.
    stale = EQUIPOISE_STALE,             // States arrived, but all were too old.
    other_clock = EQUIPOISE_OTHER_CLOCK, // Both must run in one time namespace.
    bus = EQUIPOISE_BUS,                 // The bus cannot be read; the consumer rejoins by itself.
    wrong_use = EQUIPOISE_WRONG_USE,     // Another thread's consumer, another header.
    defect = EQUIPOISE_DEFECT,           // Of the library.
};

inline const char *name(NoStateReason reason) noexcept {
    switch (reason) {
    case NoStateReason::silent: return "silent";
    case NoStateReason::stale: return "stale";
    case NoStateReason::other_clock: return "other_clock";
    case NoStateReason::bus: return "bus";
    case NoStateReason::wrong_use: return "wrong_use";
    case NoStateReason::defect: return "defect";
    }
    return "unknown";
}

// Public name of a bit of reasons(), such as "suit_stale"; nullptr for an undefined bit.
inline const char *reason_name(std::uint32_t bit) noexcept { return equipoise_reason_name(bit); }

// A current state, or the reason why there is none.
class Reading {
public:
    explicit Reading(const State &state) noexcept : either_(state) {}
    explicit Reading(NoStateReason reason) noexcept : either_(reason) {}

    explicit operator bool() const noexcept { return std::holds_alternative<State>(either_); }
    // Require a state; otherwise they throw std::bad_variant_access.
    const State &operator*() const { return std::get<State>(either_); }
    const State *operator->() const { return &std::get<State>(either_); }
    // Requires that there is no state; otherwise it throws std::bad_variant_access.
    NoStateReason reason() const { return std::get<NoStateReason>(either_); }

private:
    std::variant<State, NoStateReason> either_;
};

// Cause of a failed opening, and remedy.
class Error : public std::runtime_error {
public:
    Error(NoStateReason reason, const char *text) : std::runtime_error(text), reason_(reason) {}
    NoStateReason reason() const noexcept { return reason_; }

private:
    NoStateReason reason_;
};

struct Options {
    // Maximum age of returned states; zero: 25 ms. Negative values are rejected.
    std::chrono::nanoseconds stale_after{0};
    // Number of states that are queued while the program is busy; 0: 8. 1 if only the newest is needed.
    std::uint32_t depth = 0;
    // Whether to publish the latency of received states.
    bool report = true;
};

// Reader of one station. Only the thread that constructed it may use, move and destroy it; it cannot be copied. If another
// thread destroys it, its resources on the bus are released only at the end of the process, with a message on standard
// error.
class Consumer {
public:
    // Joins a station as `name` (1 to 32 letters, digits, '-', '_'). The daemon need not run yet. Throws Error.
    Consumer(const std::string &station, const std::string &name, const Options &options = {}) {
        if (options.stale_after < std::chrono::nanoseconds::zero()) {
            // As an unsigned number it would be centuries, so no state would be too old.
            throw Error(NoStateReason::wrong_use, "stale_after is less than zero: leave it zero for 25 ms, or set a longer time");
        }
        equipoise_options asked = EQUIPOISE_OPTIONS_DEFAULT;
        asked.stale_after_ns = static_cast<std::uint64_t>(options.stale_after.count());
        asked.depth = options.depth;
        asked.no_report = options.report ? 0 : 1;
        const int outcome = equipoise_open(station.c_str(), name.c_str(), &asked, &consumer_);
        if (outcome != EQUIPOISE_OK) {
            throw Error(static_cast<NoStateReason>(outcome), equipoise_error());
        }
    }
    ~Consumer() {
        if (equipoise_close(consumer_) != EQUIPOISE_OK) {
            std::fprintf(stderr, "equipoise: a consumer was not closed: %s\n", equipoise_error());
        }
    }
    Consumer(const Consumer &) = delete;
    Consumer &operator=(const Consumer &) = delete;
    Consumer(Consumer &&other) noexcept : consumer_(std::exchange(other.consumer_, nullptr)) {}
    Consumer &operator=(Consumer &&other) noexcept {
        std::swap(consumer_, other.consumer_);
        return *this;
    }

    // The oldest state not yet returned; sleeps until one arrives or the time has passed. A negative time is zero.
    Reading next(std::chrono::nanoseconds timeout) noexcept {
        equipoise_reading reading;
        const auto count = timeout.count() > 0 ? static_cast<std::uint64_t>(timeout.count()) : 0;
        return result(equipoise_next(consumer_, count, &reading), reading);
    }
    // The newest state, without sleeping; it may have been returned before (is_new), but is never too old.
    Reading latest() noexcept {
        equipoise_reading reading;
        return result(equipoise_latest(consumer_, &reading), reading);
    }
    // The newest early state, without sleeping; nullopt without a current one (last_error gives the reason). The first
    // call subscribes.
    std::optional<EarlyState> early() noexcept {
        equipoise_early_reading reading;
        const bool is_current = equipoise_early(consumer_, &reading) == EQUIPOISE_OK;
        return is_current ? std::optional<EarlyState>(EarlyState(reading)) : std::nullopt;
    }
    // Message of this thread's last reading without a state.
    static const char *last_error() noexcept { return equipoise_error(); }
    // Reason why the latency of received states is not published; "" if it is. In another thread than the consumer's: a
    // message about that.
    const char *report_refusal() const noexcept { return equipoise_report_refusal(consumer_); }

private:
    static Reading result(int outcome, const equipoise_reading &reading) noexcept {
        return outcome == EQUIPOISE_OK ? Reading(State(reading)) : Reading(static_cast<NoStateReason>(outcome));
    }

    equipoise_consumer *consumer_ = nullptr;
};

} // namespace equipoise

#endif
