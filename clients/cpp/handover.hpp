// Decision of a handover controller: from a reading of the worker's state to a command of the cobot. No I/O, no clock, no
// allocation. clients/python/handover.py is the same decision in Python; clients/handover_vectors.txt tests both.
//
// Not a safety function.
#ifndef EQUIPOISE_HANDOVER_HPP
#define EQUIPOISE_HANDOVER_HPP

#include "equipoise.h"

#include <cmath>
#include <cstdint>
#include <optional>

namespace equipoise::handover {

// Greatest age of a state, s.
inline constexpr double AGE_MAX_S = 0.05;
// A longer time between two decisions interrupts the valid readings, s.
inline constexpr double GAP_MAX_S = 0.05;
// Motion begins after uninterrupted valid readings of this duration, s.
inline constexpr double RESUME_AFTER_S = 0.5;
// `model_changed` lasts 1 s: after a gap of this duration between two states the worker may have changed, s.
inline constexpr double STATE_GAP_MAX_S = 0.9;
// The cobot retreats after this time without a valid reading, if it has been ready for as long, s.
inline constexpr double RETREAT_AFTER_S = 2.0;
// A better target must stay better for this time, s.
inline constexpr double BETTER_FOR_S = 1.0;
// Speed of the commanded position, m/s, and the longest time step that it is computed for, s.
inline constexpr double TARGET_M_PER_S = 0.1;
inline constexpr double TIME_STEP_MAX_S = 0.02;
// A commanded position farther from the part restarts from the part, m.
inline constexpr double LAG_MAX_M = 0.05;
// Without a plan the part is moved along the relieving direction while the worst joint's limit ratio is above this,
// by this distance, m.
inline constexpr double ADVICE_ABOVE = 0.6;
inline constexpr double ADVICE_STEP_M = 0.05;

// Flags that stop the cobot. A worker without a load is a valid state: the part is still to be handed over.
inline constexpr std::uint64_t STOPS = EQUIPOISE_INVALIDATES_TORQUES & ~EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD;

// Position in the station's world, m.
struct Position {
    double x, y, z;
};

// Place of the hands for the present worker and part.
struct Plan {
    // Increments with each new plan, from 1.
    std::uint64_t generation;
    Position at_m;
    // Predicted limit ratio of the worst joint, and its 1-σ.
    double limit_ratio, sigma;
    // Slope of the handles: how far hands that follow them point below the horizontal, rad.
    double slope_rad = 0.0;
    // Heading of the handles: that of the worker's feet, from the station's X axis about Z, rad. The grips lie on the
    // station's Y axis turned by it, and slope about that axis.
    double heading_rad = 0.0;
};

struct Input {
    // There is a current state; the fields up to `advice` belong to it.
    bool has_state = false;
    std::uint64_t reasons = 0;
    double age_s = 0.0;
    bool restarted = false;
    // Torque of the worst joint over its limit, and its 1-σ; nullopt while torques are invalid.
    std::optional<double> limit_ratio, sigma;
    // Relieving direction, unit vector.
    std::optional<Position> advice;
    // Position of the part; nullopt while the cobot is not connected or not ready.
    std::optional<Position> part_m;
    // The cobot does not follow the commands: outside the workspace, or no heartbeat.
    bool is_held = false;
    std::optional<Plan> plan;
};

enum class Command { hold = 0, move = 1, retreat = 2 };

struct Output {
    Command command;
    // With `move`: the commanded position, m, and slope and heading of the handles, rad.
    Position target_m;
    double slope_rad = 0.0, heading_rad = 0.0;
};

class Decision {
public:
    // `now_s` never decreases.
    Output decide(double now_s, const Input &input) {
        const double step_s = now_s - decided_s_;
        const bool interrupted = !decided_ || step_s > GAP_MAX_S;
        decided_ = true;
        decided_s_ = now_s;
        if (input.plan && input.plan->generation > generation_) {
            generation_ = input.plan->generation;
        }
        bool may_have_changed = false;
        if (input.has_state) {
            const double state_s = now_s - input.age_s;
            may_have_changed = input.restarted || (input.reasons & EQUIPOISE_REASON_MODEL_CHANGED) != 0 ||
                               (state_s_ && state_s - *state_s_ >= STATE_GAP_MAX_S);
            state_s_ = state_s;
        }
        if (may_have_changed) {
            // The plan and the target were for another worker, or for another model of this one.
            discarded_ = generation_;
            target_.reset();
            better_since_s_.reset();
        }
        const bool valid = input.has_state && !input.restarted && (input.reasons & STOPS) == 0 && input.age_s >= 0.0 &&
                           input.age_s <= AGE_MAX_S;
        if (valid) {
            valid_s_ = now_s;
        }
        if (!valid || !input.part_m || interrupted) {
            valid_since_s_.reset();
            better_since_s_.reset();
        }
        if (valid && input.part_m && !valid_since_s_) {
            valid_since_s_ = now_s;
        }
        if (!input.part_m || interrupted) {
            ready_since_s_.reset();
        }
        if (input.part_m && !ready_since_s_) {
            ready_since_s_ = now_s;
        }
        if (valid_since_s_ && now_s - *valid_since_s_ >= RESUME_AFTER_S) {
            choose(now_s, input);
            if (target_) {
                advance(step_s, *input.part_m, input.is_held);
                slope_rad_ = target_->slope_rad;
                heading_rad_ = target_->heading_rad;
                return {Command::move, sent_m_, slope_rad_, heading_rad_};
            }
        }
        is_moving_ = false;
        const bool retreats = has_moved_ && ready_since_s_ && now_s - *ready_since_s_ >= RETREAT_AFTER_S &&
                              now_s - valid_s_ >= RETREAT_AFTER_S;
        return {retreats ? Command::retreat : Command::hold, sent_m_};
    }

private:
    struct Target {
        std::uint64_t generation; // 0: from the advice.
        Position at_m;
        double limit_ratio, sigma;
        double slope_rad = 0.0, heading_rad = 0.0;
    };

    void choose(double now_s, const Input &input) {
        // Without a heading the handles cannot be turned to the worker: such a plan is discarded.
        if (input.plan && input.plan->generation > discarded_ && std::isfinite(input.plan->heading_rad)) {
            const Plan &plan = *input.plan;
            const Target planned{plan.generation, plan.at_m, plan.limit_ratio, plan.sigma, plan.slope_rad, plan.heading_rad};
            if (!target_) {
                set(planned);
            } else if (target_->generation == plan.generation) {
                better_since_s_.reset();
            } else {
                const double sigma = std::sqrt(target_->sigma * target_->sigma + plan.sigma * plan.sigma);
                set_if_better(now_s, target_->limit_ratio - plan.limit_ratio > sigma, planned);
            }
            return;
        }
        if ((target_ && target_->generation != 0) || !input.limit_ratio || !input.sigma || !input.advice) {
            better_since_s_.reset();
            return;
        }
        const Position &part = *input.part_m, &along = *input.advice;
        const Position at{part.x + ADVICE_STEP_M * along.x, part.y + ADVICE_STEP_M * along.y,
                          part.z + ADVICE_STEP_M * along.z};
        set_if_better(now_s, *input.limit_ratio - ADVICE_ABOVE > *input.sigma,
                      {0, at, *input.limit_ratio, *input.sigma, slope_rad_, heading_rad_});
    }

    void set_if_better(double now_s, bool is_better, const Target &candidate) {
        if (!is_better) {
            better_since_s_.reset();
        } else if (!better_since_s_) {
            better_since_s_ = now_s;
        } else if (now_s - *better_since_s_ >= BETTER_FOR_S) {
            set(candidate);
        }
    }

    void set(const Target &target) {
        target_ = target;
        better_since_s_.reset();
    }

    // Moves the commanded position toward the target.
    void advance(double step_s, const Position &part_m, bool is_held) {
        if (!is_moving_ || is_held || distance_m(part_m, sent_m_) > LAG_MAX_M) {
            sent_m_ = part_m;
        }
        is_moving_ = has_moved_ = true;
        const double x = target_->at_m.x - sent_m_.x, y = target_->at_m.y - sent_m_.y, z = target_->at_m.z - sent_m_.z;
        const double way_m = distance_m(target_->at_m, sent_m_);
        const double most_m = TARGET_M_PER_S * (step_s < TIME_STEP_MAX_S ? step_s : TIME_STEP_MAX_S);
        if (way_m <= most_m) {
            sent_m_ = target_->at_m;
        } else {
            const double part = most_m / way_m;
            sent_m_ = {sent_m_.x + part * x, sent_m_.y + part * y, sent_m_.z + part * z};
        }
    }

    static double distance_m(const Position &a, const Position &b) {
        const double x = a.x - b.x, y = a.y - b.y, z = a.z - b.z;
        return std::sqrt(x * x + y * y + z * z);
    }

    bool decided_ = false, is_moving_ = false, has_moved_ = false;
    double decided_s_ = 0.0, valid_s_ = 0.0;
    std::uint64_t generation_ = 0, discarded_ = 0;
    // Of the last state; since when readings are valid, the cobot is ready, another target is better.
    std::optional<double> state_s_, valid_since_s_, ready_since_s_, better_since_s_;
    std::optional<Target> target_;
    Position sent_m_{0.0, 0.0, 0.0};
    double slope_rad_ = 0.0, heading_rad_ = 0.0; // Of the handles in the last `move`.
};

} // namespace equipoise::handover

#endif
