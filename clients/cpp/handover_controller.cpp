// Controller of a handover: reads the worker's state, decides (handover.hpp), and commands a cobot that runs
// clients/ur/handover.script, by RTDE. docs/cobot.md. Not a safety function.
//
//     cargo build --release -p equipoise-c
//     c++ -std=c++17 -O2 -I clients/c -I clients/cpp clients/cpp/handover_controller.cpp -L target/release -lequipoise_c
//     mv a.out handover_controller
//     LD_LIBRARY_PATH=target/release ./handover_controller station-1 192.0.2.20:30004 --plan plan.json
#include "equipoise.hpp"
#include "handover_plans.hpp"
#include "rtde.hpp"

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <string>
#include <thread>
#include <time.h>
#include <vector>

using namespace std::chrono_literals;
using namespace equipoise::handover;
using equipoise::NoStateReason;
using equipoise::Reading;

namespace {

constexpr auto TIMEOUT = 25ms, BUS_PAUSE = 10ms;
constexpr double SEND_EVERY_S = 0.008, PRINT_EVERY_S = 1.0;
constexpr std::size_t SAMPLES_MAX = 1 << 16;

volatile std::sig_atomic_t stop = 0;

std::uint64_t now_ns() {
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    return static_cast<std::uint64_t>(time.tv_sec) * 1000000000u + static_cast<std::uint64_t>(time.tv_nsec);
}

double now_s() { return 1e-9 * static_cast<double>(now_ns()); }

// What the decision needs of a reading.
Input input_of(const Reading &reading, const Cobot &cobot, double at_s, const std::optional<Plan> &plan) {
    Input input;
    input.part_m = cobot.part_m(at_s);
    input.is_held = cobot.is_held();
    input.plan = plan;
    if (!reading) {
        return input;
    }
    input.has_state = true;
    input.reasons = reading->reasons();
    input.age_s = std::chrono::duration<double>(reading->age()).count();
    input.restarted = reading->restarted();
    bool is_undecided = true;
    if (const auto worst = reading->worst_joint()) {
        is_undecided = reading->level(*worst) == equipoise::Level::undecided;
        const auto torque_nm = reading->torque_magnitude_nm(*worst);
        const auto limit_nm = reading->torque_limit_nm(*worst);
        input.limit_ratio = torque_nm->value / *limit_nm;
        input.sigma = torque_nm->sigma / *limit_nm;
    }
    const auto along = reading->advice_direction();
    if (along && !is_undecided) {
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
    for (const double quantile : {0.5, 0.99, 0.999, 1.0}) {
        if (values_s.empty()) {
            return text + "none";
        }
        const auto at = static_cast<std::size_t>(quantile * static_cast<double>(values_s.size() - 1));
        text += (quantile == 0.5 ? "" : "/") + std::to_string(std::lround(1e6 * values_s[at]));
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
        const Output output = decision.decide(at_s, input_of(reading, cobot, at_s, plans.newest));
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
            std::this_thread::sleep_for(BUS_PAUSE); // It may return at once.
        }
    }
    std::cout << "end " << percentiles("bus", bus_s) << " " << percentiles("decision", decision_s) << " "
              << percentiles("cobot", cobot.answer_s()) << std::endl;
}

} // namespace

int main(int argc, char **argv) {
    Plans plans;
    std::string name = "handover";
    bool is_usable = argc % 2 != 0, has_target = false, has_file = false;
    for (int at = 3; at + 1 < argc; at += 2) {
        const std::string option = argv[at], value = argv[at + 1];
        if (option == "--target") {
            has_target = true;
            is_usable = plans.set_target(value) && is_usable;
        } else if (option == "--plan") {
            has_file = true;
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
    // A target has no limit ratio: a plan of the file would never be better.
    is_usable = is_usable && !(has_target && has_file);
    if (!is_usable || !cobot.is_valid() || port < 1 || port > 65535) {
        std::cerr << "usage: handover_controller STATION IPV4:PORT [--target X,Y,Z | --plan FILE] [--name NAME]\n";
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
