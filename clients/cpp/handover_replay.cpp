// Runs the decision of handover.hpp on readings from standard input, for tests and for the study of recorded situations.
// One line per reading: time state reasons age restarted ratio sigma advice(3) part(3) generation plan(3) plan_ratio
// plan_sigma plan_slope plan_heading held; numbers in s, m and rad, `nan` for a missing value, `reset` for a new decision. Prints the
// command, its target, slope and heading. `target WORDS` and `file TEXT` print the position or plan, or `invalid`; `poll PATH` prints
// the generation of the newest plan of this file.
#include "handover_plans.hpp"

#include <cstdlib>
#include <iomanip>
#include <iostream>
#include <sstream>
#include <string>
#include <vector>

using namespace equipoise::handover;

namespace {

std::optional<double> number(double value) { return std::isnan(value) ? std::nullopt : std::optional<double>(value); }

std::optional<Position> position(const double *values) {
    return std::isnan(values[0]) ? std::nullopt : std::optional<Position>({values[0], values[1], values[2]});
}

Input input_of(const std::vector<double> &values) {
    Input input;
    input.has_state = values[1] != 0.0;
    input.reasons = static_cast<std::uint64_t>(values[2]);
    input.age_s = values[3];
    input.restarted = values[4] != 0.0;
    input.limit_ratio = number(values[5]);
    input.sigma = number(values[6]);
    input.advice = position(&values[7]);
    input.part_m = position(&values[10]);
    if (const auto at_m = position(&values[14])) {
        input.plan = Plan{static_cast<std::uint64_t>(values[13]), *at_m, values[17], values[18], values[19], values[20]};
    }
    input.is_held = values[21] != 0.0;
    return input;
}

void print(const Position &at_m) { std::cout << at_m.x << " " << at_m.y << " " << at_m.z; }

// Answers a line that is not a reading.
bool answer(const std::string &line, Plans &plans) {
    static double polled_s = 0.0;
    const std::string what = line.substr(0, line.find(' ')), rest = line.substr(std::min(what.size() + 1, line.size()));
    if (what == "target") {
        const auto at_m = target_of(rest);
        at_m ? print(*at_m) : void(std::cout << "invalid");
    } else if (what == "file") {
        const auto plan = plan_of(rest, 1);
        plan ? print(plan->at_m) : void(std::cout << "invalid");
        if (plan) {
            std::cout << " " << plan->limit_ratio << " " << plan->sigma << " " << plan->slope_rad << " " << plan->heading_rad;
        }
    } else if (what == "poll") {
        plans.set_path(rest);
        plans.poll(polled_s += 1.0);
        std::cout << (plans.newest ? plans.newest->generation : 0);
    } else {
        return false;
    }
    std::cout << std::endl;
    return true;
}

} // namespace

int main() {
    // Standard streams with buffers of their own, not character by character through those of C.
    std::ios::sync_with_stdio(false);
    constexpr std::size_t NUMBERS = 22;
    Decision decision;
    Plans plans;
    std::string line;
    std::cout << std::fixed << std::setprecision(9);
    while (std::getline(std::cin, line)) {
        if (line == "reset") {
            decision = Decision();
            continue;
        }
        if (answer(line, plans)) {
            continue;
        }
        std::vector<double> values;
        std::istringstream words(line);
        for (std::string word; words >> word;) {
            values.push_back(std::strtod(word.c_str(), nullptr));
        }
        if (values.size() != NUMBERS) {
            std::cerr << "not " << NUMBERS << " numbers: " << line << "\n";
            return 2;
        }
        const Output output = decision.decide(values[0], input_of(values));
        std::cout << static_cast<int>(output.command) << " " << output.target_m.x << " " << output.target_m.y << " "
                  << output.target_m.z << " " << output.slope_rad << " " << output.heading_rad << std::endl;
    }
    return 0;
}
