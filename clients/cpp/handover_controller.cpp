// Controller of a handover: reads the worker's state, decides (handover.hpp), and commands a cobot that runs
// clients/ur/handover.script, by RTDE. docs/cobot.md. Not a safety function.
//
//     cargo build --release -p equipoise-c
//     c++ -std=c++17 -O2 -I clients/c -I clients/cpp clients/cpp/handover_controller.cpp -L target/release -lequipoise_c
//     mv a.out handover_controller
//     LD_LIBRARY_PATH=target/release ./handover_controller station-1 192.0.2.20:30004 --plan plan.json
#include "equipoise.hpp"
#include "rtde.hpp"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>
#include <string>
#include <sys/stat.h>
#include <thread>
#include <time.h>
#include <vector>

using namespace std::chrono_literals;
using namespace equipoise::handover;
using equipoise::NoStateReason;
using equipoise::Reading;

namespace {

constexpr auto TIMEOUT = 25ms, BUS_PAUSE = 10ms;
constexpr double SEND_EVERY_S = 0.008, PLAN_EVERY_S = 0.2, PRINT_EVERY_S = 1.0;
constexpr std::size_t SAMPLES_MAX = 1 << 16;

volatile std::sig_atomic_t stop = 0;

std::uint64_t now_ns() {
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    return static_cast<std::uint64_t>(time.tv_sec) * 1000000000u + static_cast<std::uint64_t>(time.tv_nsec);
}

double now_s() { return 1e-9 * static_cast<double>(now_ns()); }

// Numbers after "KEY": in a JSON text, without its brackets and commas; as many as `count`.
std::optional<std::vector<double>> numbers_of(const std::string &text, const std::string &key, std::size_t count) {
    const auto at = text.find('"' + key + '"');
    const auto colon = at == std::string::npos ? at : text.find(':', at);
    if (colon == std::string::npos) {
        return std::nullopt;
    }
    std::string rest = text.substr(colon + 1, 1000);
    std::replace_if(rest.begin(), rest.end(), [](char c) { return c == '[' || c == ',' || c == ']' || c == '}'; }, ' ');
    std::istringstream words(rest);
    std::vector<double> numbers(count);
    for (double &number : numbers) {
        if (!(words >> number) || !std::isfinite(number)) {
            return std::nullopt;
        }
    }
    return numbers;
}

// The newest plan: a position from the command line, or a file, read again when it changes.
class Plans {
public:
    bool set_target(const std::string &words) {
        const auto at = numbers_of("\"target\": " + words, "target", 3);
        if (at) {
            newest = Plan{1, {(*at)[0], (*at)[1], (*at)[2]}, 0.0, 0.0};
        }
        return at.has_value();
    }
    void set_path(const std::string &path) { path_ = path; }

    // One that cannot be read leaves the plan as it is.
    void poll(double now_s) {
        struct stat found {};
        if (path_.empty() || now_s < due_s_) {
            return;
        }
        due_s_ = now_s + PLAN_EVERY_S;
        if (stat(path_.c_str(), &found) != 0 || is_same(found.st_mtim, changed_)) {
            return;
        }
        std::ifstream file(path_);
        std::stringstream text;
        text << file.rdbuf();
        const auto at = numbers_of(text.str(), "position_m", 3);
        const auto limit_ratio = numbers_of(text.str(), "worst_limit_ratio", 1), sigma = numbers_of(text.str(), "worst_limit_ratio_sigma", 1);
        if (!at || !limit_ratio || !sigma) {
            // The file may be incomplete: read it again at the next poll, and report each version once.
            if (!is_same(found.st_mtim, reported_)) {
                std::cerr << path_ << ": no valid position_m, worst_limit_ratio and worst_limit_ratio_sigma; `equipoise plan handover --out "
                          << path_ << "` writes it" << std::endl;
            }
            reported_ = found.st_mtim;
            return;
        }
        changed_ = found.st_mtim;
        const std::uint64_t generation = newest ? newest->generation + 1 : 1;
        // Absent in plans of earlier versions.
        const auto slope = numbers_of(text.str(), "slope_rad", 1);
        newest = Plan{generation, {(*at)[0], (*at)[1], (*at)[2]}, (*limit_ratio)[0], (*sigma)[0], slope ? (*slope)[0] : 0.0};
    }

    std::optional<Plan> newest;

private:
    static bool is_same(const timespec &a, const timespec &b) { return a.tv_sec == b.tv_sec && a.tv_nsec == b.tv_nsec; }

    std::string path_;
    double due_s_ = 0.0;
    timespec changed_{}, reported_{};
};

// What the decision needs of a reading.
Input input_of(const Reading &reading, const std::optional<Position> &part_m, const std::optional<Plan> &plan) {
    Input input;
    input.part_m = part_m;
    input.plan = plan;
    if (!reading) {
        return input;
    }
    input.has_state = true;
    input.reasons = reading->reasons();
    input.age_s = std::chrono::duration<double>(reading->age()).count();
    input.restarted = reading->restarted();
    if (const auto worst = reading->worst_joint()) {
        const auto torque_nm = reading->torque_magnitude_nm(*worst);
        const auto limit_nm = reading->torque_limit_nm(*worst);
        input.limit_ratio = torque_nm->value / *limit_nm;
        input.sigma = torque_nm->sigma / *limit_nm;
    }
    if (const auto along = reading->advice_direction()) {
        input.advice = Position{along->x, along->y, along->z};
    }
    return input;
}

void print(double at_s, const Output &output, int activity, const Reading &reading) {
    static const char *const names[] = {"hold", "move", "retreat"};
    std::string why;
    for (std::uint32_t bit = 0; reading && bit < 64; bit++) {
        const char *name = equipoise::reason_name(bit);
        if ((reading->reasons() >> bit & 1) != 0 && name != nullptr) {
            why += (why.empty() ? "" : "+") + std::string(name);
        }
    }
    std::printf("at_s=%.3f command=%s target_m=%.3f,%.3f,%.3f activity=%d reasons=%s\n", at_s,
                names[static_cast<int>(output.command)], output.target_m.x, output.target_m.y, output.target_m.z, activity,
                reading ? why.c_str() : equipoise::name(reading.reason()));
    std::fflush(stdout);
}

// p50, p99, p99.9 and maximum, microseconds.
std::string percentiles(const char *name, std::vector<double> values_s) {
    std::sort(values_s.begin(), values_s.end());
    std::string text = std::string(name) + "_us=";
    for (const double probability : {0.5, 0.99, 0.999, 1.0}) {
        if (values_s.empty()) {
            return text + "none";
        }
        const auto at = static_cast<std::size_t>(probability * static_cast<double>(values_s.size() - 1));
        text += (probability == 0.5 ? "" : "/") + std::to_string(std::lround(1e6 * values_s[at]));
    }
    return text;
}

void run(const std::string &station, const std::string &name, Cobot &cobot, Plans &plans) {
    equipoise::Consumer consumer(station, name);
    Decision decision;
    Command last = Command::hold;
    double send_at_s = 0.0, print_at_s = 0.0;
    std::vector<double> bus_s, decision_s;
    while (stop == 0) {
        const Reading reading = consumer.next(TIMEOUT);
        const double at_s = now_s();
        cobot.poll(at_s);
        plans.poll(at_s);
        const Output output = decision.decide(at_s, input_of(reading, cobot.part_m(at_s), plans.newest));
        if (output.command != last || at_s >= send_at_s) {
            cobot.send(now_s(), output);
            send_at_s = at_s + SEND_EVERY_S;
            if (reading && bus_s.size() < SAMPLES_MAX) {
                const auto &raw = reading->raw();
                bus_s.push_back(1e-9 * static_cast<double>(raw.received_ns - std::min(raw.received_ns, raw.state.published_ns)));
                decision_s.push_back(now_s() - 1e-9 * static_cast<double>(raw.received_ns));
            }
        }
        if (output.command != last || at_s >= print_at_s) {
            print(at_s, output, cobot.activity(), reading);
            print_at_s = at_s + PRINT_EVERY_S;
        }
        last = output.command;
        if (!reading && reading.reason() >= NoStateReason::bus) {
            std::this_thread::sleep_for(BUS_PAUSE); // It returns at once.
        }
    }
    std::cout << "end " << percentiles("bus", bus_s) << " " << percentiles("decision", decision_s) << " "
              << percentiles("cobot", cobot.answer_s()) << std::endl;
}

} // namespace

int main(int argc, char **argv) {
    Plans plans;
    std::string name = "handover";
    bool is_usable = argc % 2 != 0;
    for (int at = 3; at + 1 < argc; at += 2) {
        const std::string option = argv[at], value = argv[at + 1];
        if (option == "--target") {
            is_usable = plans.set_target(value) && is_usable;
        } else if (option == "--plan") {
            plans.set_path(value);
        } else if (option == "--name") {
            name = value;
        } else {
            is_usable = false;
        }
    }
    const std::string address = argc > 2 ? argv[2] : "";
    const auto colon = address.rfind(':');
    const long port = colon == std::string::npos ? 0 : std::strtol(address.c_str() + colon + 1, nullptr, 10);
    Cobot cobot(address.substr(0, colon), static_cast<std::uint16_t>(port));
    if (!is_usable || !cobot.is_valid() || port < 1 || port > 65535) {
        std::cerr << "usage: handover_controller STATION IPV4:PORT [--target X,Y,Z] [--plan FILE] [--name NAME]\n";
        return 2;
    }
    for (const int number : {SIGINT, SIGTERM}) {
        std::signal(number, [](int) { stop = 1; });
    }
    try {
        run(argv[1], name, cobot, plans);
    } catch (const equipoise::Error &error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
    return 0;
}
