// Reads the states of an Equipoise station, from C++17: the C interface (clients/c/equipoise.h) with owners and types.
//
//     cargo build --release -p equipoise-c
//     c++ -std=c++17 -I clients/c -I clients/cpp controller.cpp -L target/release -lequipoise_c
//
// clients/cpp/controller.cpp is a whole program; docs/consumers/cpp.md says what to check before a value is used.
// The constructor of Consumer throws Error. Nothing after it throws, but std::bad_variant_access where a Reading is asked for
// what it does not hold: `*` and `->` without a state, why() with one. Nothing after it allocates.
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

// A value with its standard deviation, both in the unit of the name that gave them.
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

// How close a torque is to the joint's limit. Undecided is the highest: treat it as the worst.
enum class Level : std::uint32_t {
    none = EQUIPOISE_LEVEL_NONE,
    green = EQUIPOISE_LEVEL_GREEN,
    orange = EQUIPOISE_LEVEL_ORANGE,
    red = EQUIPOISE_LEVEL_RED,
    above_max = EQUIPOISE_LEVEL_ABOVE_MAX,
    undecided = EQUIPOISE_LEVEL_UNDECIDED,
};

// A state that is current. What a reason spoils is nullopt: there is no way to a value that must not be used but raw().
class State {
public:
    explicit State(const equipoise_reading &reading) noexcept : reading_(reading) {}

    // Everything, as the C interface has it; look at `valid` before you use a value of it.
    const equipoise_reading &raw() const noexcept { return reading_; }

    std::uint64_t cycle() const noexcept { return reading_.state.cycle; }
    std::chrono::nanoseconds age() const noexcept { return nanoseconds(reading_.age_ns); }
    // Of the moment that torques, forces and centres are about; nullopt before the first.
    std::optional<std::chrono::nanoseconds> moment_age() const noexcept {
        if (reading_.moment_age_ns == UINT64_MAX) {
            return std::nullopt;
        }
        return nanoseconds(reading_.moment_age_ns);
    }
    // States since the last one that were not handed out.
    std::uint64_t missed() const noexcept { return reading_.missed; }
    // The daemon was restarted since the last state: the subject may be another one, or not identified yet.
    bool restarted() const noexcept { return reading_.restarted != 0; }
    bool is_new() const noexcept { return reading_.is_new != 0; }

    // EQUIPOISE_REASON_…: why values are withheld.
    std::uint64_t reasons() const noexcept { return reading_.state.valid; }
    // Nothing is carried, and nothing else is wrong: that is knowledge, not the lack of it.
    bool is_unloaded() const noexcept { return reasons() == EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD; }

    std::optional<Vector3> torque_nm(Joint joint) const noexcept {
        return unless(EQUIPOISE_SPOILS_TORQUES, vector(reading_.state.torque_nm[index(joint)]));
    }
    // Magnitude and its 1-σ.
    std::optional<WithSigma> torque_magnitude_nm(Joint joint) const noexcept {
        const double length_nm = vector(reading_.state.torque_nm[index(joint)]).length();
        return unless(EQUIPOISE_SPOILS_TORQUES, WithSigma{length_nm, reading_.state.torque_sigma_nm[index(joint)]});
    }
    std::optional<double> torque_limit_nm(Joint joint) const noexcept {
        return unless(EQUIPOISE_SPOILS_TORQUES, reading_.state.torque_limit_nm[index(joint)]);
    }
    std::optional<Level> level(Joint joint) const noexcept {
        return unless(EQUIPOISE_SPOILS_TORQUES, static_cast<Level>(reading_.state.joint_level[index(joint)]));
    }
    // The highest of all joints.
    std::optional<Level> worst_level() const noexcept {
        std::uint32_t worst = EQUIPOISE_LEVEL_NONE;
        for (const std::uint32_t level : reading_.state.joint_level) {
            worst = level > worst ? level : worst;
        }
        return unless(EQUIPOISE_SPOILS_TORQUES, static_cast<Level>(worst));
    }
    // The joint closest to its limit.
    std::optional<Joint> worst_joint() const noexcept {
        if (reading_.state.worst_joint >= joints) {
            return std::nullopt;
        }
        return unless(EQUIPOISE_SPOILS_TORQUES, static_cast<Joint>(reading_.state.worst_joint));
    }
    // 0 to 1; never withheld.
    double fatigue(Joint joint) const noexcept { return reading_.state.fatigue[index(joint)]; }

    std::optional<WithSigma> lifted_mass_kg() const noexcept {
        return unless(EQUIPOISE_SPOILS_LIFTED_MASS,
                      WithSigma{reading_.state.lifted_mass_kg, reading_.state.lifted_mass_sigma_kg});
    }
    // Horizontal, from the middle of the ankles to the load.
    std::optional<double> reach_m() const noexcept {
        return unless(EQUIPOISE_SPOILS_TORQUES, reading_.state.reach_m);
    }
    // External force carried.
    std::optional<Vector3> delta_f_n() const noexcept {
        return unless(EQUIPOISE_SPOILS_DELTA_F, vector(reading_.state.delta_f_n));
    }
    // Without its horizontal part where the station's sensors do not give it.
    std::optional<double> ground_force_up_n() const noexcept {
        return unless(EQUIPOISE_SPOILS_GROUND_FORCE, reading_.state.ground_force_n[2]);
    }
    std::optional<WithSigma> l5s1_compression_n() const noexcept {
        return unless(EQUIPOISE_SPOILS_BACK,
                      WithSigma{reading_.state.l5s1_compression_n, reading_.state.l5s1_compression_sigma_n});
    }
    // Unit vector: where the load should move to relieve the worst joint; nullopt if nowhere.
    std::optional<Vector3> advice_direction() const noexcept {
        const Vector3 direction = vector(reading_.state.advice_direction);
        return direction.length() > 0.0 ? unless(EQUIPOISE_SPOILS_TORQUES, direction) : std::nullopt;
    }

private:
    static std::chrono::nanoseconds nanoseconds(std::uint64_t count) noexcept {
        return std::chrono::nanoseconds(static_cast<std::chrono::nanoseconds::rep>(count));
    }
    static std::size_t index(Joint joint) noexcept { return static_cast<std::size_t>(joint); }
    static Vector3 vector(const double (&components)[3]) noexcept {
        return {components[0], components[1], components[2]};
    }
    template <typename Value> std::optional<Value> unless(std::uint64_t spoilers, Value value) const noexcept {
        return (reasons() & spoilers) == 0 ? std::optional<Value>(value) : std::nullopt;
    }

    equipoise_reading reading_;
};

// Why there is no current state.
enum class Why {
    silent = EQUIPOISE_SILENT,           // No new state came in time: the daemon is not running, or hangs.
    stale = EQUIPOISE_STALE,             // States came, but all too old.
    other_clock = EQUIPOISE_OTHER_CLOCK, // Both must run in one time namespace.
    bus = EQUIPOISE_BUS,                 // The bus cannot be read; the consumer rejoins by itself.
    wrong_use = EQUIPOISE_WRONG_USE,     // Another thread's consumer, another header.
    defect = EQUIPOISE_DEFECT,           // Of the library.
};

inline const char *name(Why why) noexcept {
    switch (why) {
    case Why::silent: return "silent";
    case Why::stale: return "stale";
    case Why::other_clock: return "other_clock";
    case Why::bus: return "bus";
    case Why::wrong_use: return "wrong_use";
    case Why::defect: return "defect";
    }
    return "unknown";
}

// The public name of a bit of reasons(), such as "suit_stale"; nullptr for a bit that has none.
inline const char *reason_name(std::uint32_t bit) noexcept { return equipoise_reason_name(bit); }

// A state that is current, or why there is none.
class Reading {
public:
    explicit Reading(const State &state) noexcept : either_(state) {}
    explicit Reading(Why why) noexcept : either_(why) {}

    explicit operator bool() const noexcept { return std::holds_alternative<State>(either_); }
    // Only where there is one; else they throw std::bad_variant_access.
    const State &operator*() const { return std::get<State>(either_); }
    const State *operator->() const { return &std::get<State>(either_); }
    // Only where there is no state; else it throws std::bad_variant_access.
    Why why() const { return std::get<Why>(either_); }

private:
    std::variant<State, Why> either_;
};

// What could not be opened, and what to do about it.
class Error : public std::runtime_error {
public:
    Error(Why why, const char *text) : std::runtime_error(text), why_(why) {}
    Why why() const noexcept { return why_; }

private:
    Why why_;
};

struct Options {
    // A state is handed out only while it is younger than this; zero: 25 ms. Less than zero is refused.
    std::chrono::nanoseconds stale_after{0};
    // States that wait while the program is busy; 0: 8. 1 for who only wants the newest.
    std::uint32_t depth = 0;
    // Whether to publish how late states come.
    bool report = true;
};

// Reads one station. Belongs to the thread that made it; can be moved within it, not copied. It must die there, too: in
// another thread its place on the bus is not given back before the process ends, and standard error says so.
class Consumer {
public:
    // Joins a station as `name` (1 to 32 letters, digits, '-', '_'). The daemon need not run yet. Throws Error.
    Consumer(const std::string &station, const std::string &name, const Options &options = {}) {
        if (options.stale_after < std::chrono::nanoseconds::zero()) {
            // As an unsigned number it would be centuries: no state would ever be too old.
            throw Error(Why::wrong_use, "stale_after is less than zero: leave it zero for 25 ms, or set a longer time");
        }
        equipoise_options asked = EQUIPOISE_OPTIONS_DEFAULT;
        asked.stale_after_ns = static_cast<std::uint64_t>(options.stale_after.count());
        asked.depth = options.depth;
        asked.no_report = options.report ? 0 : 1;
        const int outcome = equipoise_open(station.c_str(), name.c_str(), &asked, &consumer_);
        if (outcome != EQUIPOISE_OK) {
            throw Error(static_cast<Why>(outcome), equipoise_error());
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

    // The next state not yet handed out; sleeps until one comes or the time has passed. Less than zero is no time.
    Reading next(std::chrono::nanoseconds timeout) noexcept {
        equipoise_reading reading;
        const auto count = timeout.count() > 0 ? static_cast<std::uint64_t>(timeout.count()) : 0;
        return judged(equipoise_next(consumer_, count, &reading), reading);
    }
    // The newest state there is, without sleeping; it may have been handed out before (is_new), but is never too old.
    Reading latest() noexcept {
        equipoise_reading reading;
        return judged(equipoise_latest(consumer_, &reading), reading);
    }
    // The sentence of this thread's last reading without a state.
    static const char *last_error() noexcept { return equipoise_error(); }
    // Why nothing is published about how late states come, though it should be; "" if it is. In another thread than the
    // consumer's, that it is another.
    const char *report_refusal() const noexcept { return equipoise_report_refusal(consumer_); }

private:
    static Reading judged(int outcome, const equipoise_reading &reading) noexcept {
        return outcome == EQUIPOISE_OK ? Reading(State(reading)) : Reading(static_cast<Why>(outcome));
    }

    equipoise_consumer *consumer_ = nullptr;
};

} // namespace equipoise

#endif
