/* A cobot's controller, reduced to what it must check before it trusts a value. Prints a line a second.
 *
 *     cargo build --release -p equipoise-c
 *     cc -std=c11 -O2 -I clients/c clients/c/controller.c -L target/release -lequipoise_c -o controller
 *     LD_LIBRARY_PATH=target/release ./controller station-1 arm-left
 */
#define _POSIX_C_SOURCE 200809L
#include "equipoise.h"

#include <inttypes.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

/* How long the robot may go on without a new state. */
static const uint64_t TIMEOUT_NS = 25000000;
static const uint64_t PRINT_EVERY_NS = 1000000000;
/* Of so many states the p50 is taken. */
enum { LATENCIES_MAX = 1 << 16 };

static volatile sig_atomic_t stop = 0;

static void ask_to_stop(int signal_number) {
    (void)signal_number;
    stop = 1;
}

static uint64_t now_ns(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * UINT64_C(1000000000) + (uint64_t)time.tv_nsec;
}

/* The robot's speed for this state, percent. */
static unsigned speed_percent(const equipoise_state *state) {
    uint32_t worst = EQUIPOISE_LEVEL_NONE;
    if (state->valid == EQUIPOISE_REASON_BELOW_LOAD_THRESHOLD) {
        return 100; /* Nothing is carried: that is knowledge, not the lack of it. */
    }
    if (state->valid & EQUIPOISE_INVALIDATES_TORQUES) {
        return 25; /* Torques are withheld: careful. */
    }
    /* An undecided joint counts as its worst: its number is the highest. */
    for (int joint = 0; joint < EQUIPOISE_JOINTS; joint++) {
        if (state->joint_level[joint] > worst) {
            worst = state->joint_level[joint];
        }
    }
    return worst == EQUIPOISE_LEVEL_GREEN ? 100 : worst == EQUIPOISE_LEVEL_ORANGE ? 60 : 25;
}

/* What is counted over the whole run. */
static struct {
    uint64_t states, missed, silences, restarts, latest_due_ns, latencies;
    uint64_t latency_ns[LATENCIES_MAX];
} tally;

/* Takes in a reading; 0 if it is no later than one before, which must never be. */
static int enter(const equipoise_reading *reading) {
    const int is_later = reading->state.time_ns > tally.latest_due_ns;
    tally.latest_due_ns = reading->state.time_ns;
    tally.states++;
    tally.missed += reading->missed;
    tally.restarts += reading->restarted;
    if (tally.latencies < LATENCIES_MAX) {
        const uint64_t from_ns = reading->state.published_ns, to_ns = reading->received_ns;
        tally.latency_ns[tally.latencies++] = to_ns > from_ns ? to_ns - from_ns : 0;
    }
    return is_later;
}

static int by_size(const void *left, const void *right) {
    const uint64_t a = *(const uint64_t *)left, b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

static uint64_t p50_ns(void) {
    if (tally.latencies == 0) {
        return 0;
    }
    qsort(tally.latency_ns, tally.latencies, sizeof tally.latency_ns[0], by_size);
    /* The rank that half of the states lie at or below. */
    return tally.latency_ns[(tally.latencies - 1) / 2];
}

static void print_tally(void) {
    printf("states=%" PRIu64 " missed=%" PRIu64 " silences=%" PRIu64 " restarts=%" PRIu64 " p50_ns=%" PRIu64 "\n",
           tally.states, tally.missed, tally.silences, tally.restarts, p50_ns());
    fflush(stdout);
}

static void print_line(int outcome, const equipoise_reading *reading) {
    static const char *const NAMES[] = {"current", "silent", "stale", "other_clock", "bus", "wrong_use", "defect"};
    const equipoise_state *state = &reading->state;
    const uint64_t at_ns = now_ns();
    printf("at_ns=%" PRIu64 " state=%s ", at_ns, NAMES[outcome]);
    if (outcome == EQUIPOISE_OK) {
        printf("cycle=%" PRIu64 " due_ns=%" PRIu64 " age_us=%" PRIu64 " speed_percent=%u withheld=", state->cycle,
               state->time_ns, (at_ns - state->time_ns) / 1000, speed_percent(state));
        for (uint32_t bit = 0, any = 0; bit < 64; bit++) {
            if (state->valid >> bit & 1 && equipoise_reason_name(bit) != NULL) {
                printf("%s%s", any++ ? "+" : "", equipoise_reason_name(bit));
            }
        }
        printf(" ");
    } else {
        printf("speed_percent=0 ");
    }
    print_tally();
}

int main(int argc, char **argv) {
    const struct sigaction action = {.sa_handler = ask_to_stop};
    const equipoise_options options = EQUIPOISE_OPTIONS_DEFAULT;
    equipoise_consumer *consumer = NULL;
    if (argc < 3 || argc > 4) {
        fprintf(stderr, "usage: controller STATION NAME [SECONDS]\n");
        return 2;
    }
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    if (equipoise_open(argv[1], argv[2], &options, &consumer) != EQUIPOISE_OK) {
        fprintf(stderr, "%s\n", equipoise_error());
        return 1;
    }
    if (equipoise_report_refusal(consumer)[0] != '\0') {
        fprintf(stderr, "%s; reading goes on\n", equipoise_report_refusal(consumer));
    }
    const uint64_t end_ns = argc == 4 ? now_ns() + (uint64_t)(atof(argv[3]) * 1e9) : UINT64_MAX;
    uint64_t print_ns = now_ns() + PRINT_EVERY_NS;
    char error[512] = ""; /* The last error of the bus. */
    while (!stop && now_ns() < end_ns) {
        equipoise_reading reading;
        const int outcome = equipoise_next(consumer, TIMEOUT_NS, &reading);
        if (outcome == EQUIPOISE_OK) {
            if (!enter(&reading)) {
                fprintf(stderr, "an old state as new: cycle %" PRIu64 "\n", reading.state.cycle);
                return 1;
            }
        } else {
            tally.silences++;
        }
        if (outcome < EQUIPOISE_BUS) {
            error[0] = '\0';
        } else if (strncmp(error, equipoise_error(), sizeof error - 1) != 0) {
            snprintf(error, sizeof error, "%s", equipoise_error());
            fprintf(stderr, "%s\n", error);
        }
        /* Command the robot's speed here: speed_percent, or 0 without a reading. */
        if (now_ns() >= print_ns) {
            print_line(outcome, &reading);
            print_ns += PRINT_EVERY_NS;
        }
    }
    equipoise_close(consumer);
    printf("end ");
    print_tally();
    return 0;
}
