// A cobot's controller, reduced to what it must check before it trusts a value. Prints a line a second.
//
//     cargo build --release -p equipoise-c
//     c++ -std=c++17 -O2 -I clients/c -I clients/cpp clients/cpp/controller.cpp -L target/release -lequipoise_c -o controller
//     LD_LIBRARY_PATH=target/release ./controller station-1 arm-left
#include "equipoise.hpp"

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <iostream>
#include <string>
#include <time.h>
#include <utility>
#include <vector>

using namespace std::chrono_literals;
using equipoise::Consumer;
using equipoise::Level;
using equipoise::Reading;

namespace {

// How long the robot may go on without a new state.
constexpr auto TIMEOUT = 25ms;
constexpr std::uint64_t PRINT_EVERY_NS = 1000000000;
// Of so many states the p50 is taken.
constexpr std::size_t LATENCIES_MAX = 1 << 16;

volatile std::sig_atomic_t stop = 0;

std::uint64_t now_ns() {
    timespec time{};
    clock_gettime(CLOCK_MONOTONIC, &time);
    return static_cast<std::uint64_t>(time.tv_sec) * 1000000000u + static_cast<std::uint64_t>(time.tv_nsec);
}

// The robot's speed for what is known now, percent.
unsigned speed_percent(const Reading &reading) {
    if (!reading) {
        return 0;
    }
    if (reading->is_unloaded()) {
        return 100;
    }
    const auto worst = reading->worst_level();
    if (!worst) {
        return 25; // Torques are withheld: careful.
    }
    // An undecided joint counts as its worst.
    return *worst == Level::green ? 100 : *worst == Level::orange ? 60 : 25;
}

struct Tally {
    std::uint64_t states = 0, missed = 0, silences = 0, restarts = 0, latest_due_ns = 0;
    std::vector<std::uint64_t> latencies_ns;

    // Takes in a reading; false if it is no later than one before, which must never be.
    bool enter(const Reading &reading) {
        const equipoise_reading &raw = reading->raw();
        const bool is_later = raw.state.time_ns > latest_due_ns;
        latest_due_ns = raw.state.time_ns;
        states++;
        missed += reading->missed();
        restarts += reading->restarted() ? 1 : 0;
        if (latencies_ns.size() < LATENCIES_MAX) {
            const auto from_ns = raw.state.published_ns, to_ns = raw.received_ns;
            latencies_ns.push_back(to_ns > from_ns ? to_ns - from_ns : 0);
        }
        return is_later;
    }

    void print() {
        std::sort(latencies_ns.begin(), latencies_ns.end());
        // The rank that half of the states lie at or below.
        const auto p50_ns = latencies_ns.empty() ? 0 : latencies_ns[(latencies_ns.size() - 1) / 2];
        std::cout << "states=" << states << " missed=" << missed << " silences=" << silences
                  << " restarts=" << restarts << " p50_ns=" << p50_ns << std::endl;
    }
};

void print_line(const Reading &reading) {
    const auto at_ns = now_ns();
    std::cout << "at_ns=" << at_ns << " state=" << (reading ? "current" : equipoise::name(reading.reason()));
    if (reading) {
        const auto due_ns = reading->raw().state.time_ns;
        std::cout << " cycle=" << reading->cycle() << " due_ns=" << due_ns << " age_us=" << (at_ns - due_ns) / 1000;
    }
    std::cout << " speed_percent=" << speed_percent(reading) << " ";
    if (reading) {
        std::string withheld;
        for (std::uint32_t bit = 0; bit < 64; bit++) {
            const char *name = equipoise::reason_name(bit);
            if ((reading->reasons() >> bit & 1) != 0 && name != nullptr) {
                withheld += (withheld.empty() ? "" : "+") + std::string(name);
            }
        }
        std::cout << "withheld=" << withheld << " ";
    }
}

int run(const std::string &station, const std::string &name, std::uint64_t end_ns) {
    Consumer consumer(station, name);
    if (*consumer.report_refusal() != '\0') {
        std::cerr << consumer.report_refusal() << "; reading goes on\n";
    }
    Tally tally;
    std::string bus_error;
    auto print_ns = now_ns() + PRINT_EVERY_NS;
    while (stop == 0 && now_ns() < end_ns) {
        const Reading reading = consumer.next(TIMEOUT);
        if (!reading) {
            tally.silences++;
        } else if (!tally.enter(reading)) {
            std::cerr << "an old state as new: cycle " << reading->cycle() << "\n";
            return 1;
        }
        const bool is_lost = !reading && reading.reason() >= equipoise::NoStateReason::bus;
        const std::string before = std::exchange(bus_error, is_lost ? Consumer::last_error() : "");
        if (is_lost && bus_error != before) {
            std::cerr << bus_error << "\n";
        }
        // Command the robot's speed here.
        if (now_ns() >= print_ns) {
            print_line(reading);
            tally.print();
            print_ns += PRINT_EVERY_NS;
        }
    }
    std::cout << "end ";
    tally.print();
    return 0;
}

} // namespace

int main(int argc, char **argv) {
    if (argc < 3 || argc > 4) {
        std::cerr << "usage: controller STATION NAME [SECONDS]\n";
        return 2;
    }
    for (const int number : {SIGINT, SIGTERM}) {
        std::signal(number, [](int) { stop = 1; });
    }
    const auto seconds = argc == 4 ? std::atof(argv[3]) : 0.0;
    const auto end_ns = argc == 4 ? now_ns() + static_cast<std::uint64_t>(seconds * 1e9) : UINT64_MAX;
    try {
        return run(argv[1], argv[2], end_ns);
    } catch (const equipoise::Error &error) {
        std::cerr << error.what() << "\n";
        return 1;
    }
}
