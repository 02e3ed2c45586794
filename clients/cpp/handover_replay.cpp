// Runs the decision of handover.hpp on readings from standard input, for tests and for the study of recorded situations.
// One line per reading: time state reasons age restarted limit_ratio sigma advice(3) part(3) generation plan(3) plan_limit_ratio
// plan_sigma; numbers in s and m, `nan` for a missing value, `reset` for a new decision. Prints the command and its target.
#include "handover.hpp"

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
        input.plan = Plan{static_cast<std::uint64_t>(values[13]), *at_m, values[17], values[18]};
    }
    return input;
}

} // namespace

int main() {
    constexpr std::size_t NUMBERS = 19;
    Decision decision;
    std::string line;
    std::cout << std::fixed << std::setprecision(9);
    while (std::getline(std::cin, line)) {
        if (line == "reset") {
            decision = Decision();
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
                  << output.target_m.z << std::endl;
    }
    return 0;
}
