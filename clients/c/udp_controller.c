/* A cobot's controller on another machine, reduced to what it must check before it trusts a value.
 *
 *     cc -std=c11 -O2 -I clients/c clients/c/udp_controller.c clients/c/udp_reader.c -o udp_controller
 *     ./udp_controller 7411 station-1 60        # port, station, seconds; prints a line a second
 *
 * With "each" as a fourth argument it prints a line for each datagram.
 *
 * It acts on the newest: whatever waits in the socket is taken before, for the robot's own work may take longer than the
 * time between two datagrams.
 */
#define _POSIX_C_SOURCE 200809L
#include "equipoise_udp.h"

#include <arpa/inet.h>
#include <errno.h>
#include <inttypes.h>
#include <netinet/in.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

/* How old a state may be while the robot acts on it, and how long nothing at all may come. */
static const uint64_t STALE_AFTER_NS = 50000000, NETWORK_SILENT_AFTER_NS = 100000000;

static uint64_t now_ns(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (uint64_t)time.tv_sec * UINT64_C(1000000000) + (uint64_t)time.tv_nsec;
}

/* The robot's speed for what is known now, percent. */
static unsigned speed_percent(const equipoise_udp_reader *reader, const equipoise_udp_datagram *last) {
    uint8_t worst = EQUIPOISE_UDP_LEVEL_NONE;
    if (equipoise_udp_age_ns(reader, last, now_ns()) > STALE_AFTER_NS) {
        return 0; /* Nothing came, or it said that there is no state, or the state is too old. */
    }
    if (last->valid == EQUIPOISE_UDP_REASON_BELOW_LOAD_THRESHOLD) {
        return 100; /* Nothing is carried: that is knowledge, not the lack of it. */
    }
    if (!(last->usable & EQUIPOISE_UDP_USABLE_TORQUES)) {
        return 25; /* Torques are withheld: careful. */
    }
    /* An undecided joint counts as its worst: its number is the highest. */
    for (int joint = 0; joint < EQUIPOISE_UDP_JOINTS; joint++) {
        worst = last->joint_level[joint] > worst ? last->joint_level[joint] : worst;
    }
    return worst == EQUIPOISE_UDP_LEVEL_GREEN ? 100 : worst == EQUIPOISE_UDP_LEVEL_ORANGE ? 60 : 25;
}

/* In words: what is known now. */
static const char *situation(const equipoise_udp_reader *reader, const equipoise_udp_datagram *last) {
    static const char *const STATUSES[] = {"current", "silent", "stale", "other_clock", "bus"};
    if (reader->taken == 0 || now_ns() - reader->taken_at_ns > NETWORK_SILENT_AFTER_NS) {
        return "network_silent"; /* Not the daemon: the gateway reports a silent daemon at its rate. */
    }
    return last->status < 5 ? STATUSES[last->status] : "unknown";
}

static void print_line(const equipoise_udp_reader *reader, const equipoise_udp_datagram *last) {
    uint64_t refused = 0;
    for (int outcome = 1; outcome <= EQUIPOISE_UDP_OLD; outcome++) {
        refused += reader->refused[outcome];
    }
    const uint64_t age_ns = equipoise_udp_age_ns(reader, last, now_ns());
    printf("state=%s cycle=%" PRIu64 " speed_percent=%u taken=%" PRIu64 " missed=%" PRIu64 " refused=%" PRIu64,
           situation(reader, last), last->cycle, speed_percent(reader, last), reader->taken, reader->missed, refused);
    printf(" daemon_life=%u age_ms=%" PRIi64 "\n", last->daemon_life,
           age_ns == UINT64_MAX ? -1 : (int64_t)(age_ns / 1000000));
}

static void print_each(int outcome, const equipoise_udp_datagram *one) {
    if (outcome != EQUIPOISE_UDP_TAKEN) {
        printf("refused=%s\n", equipoise_udp_outcome_name(outcome));
        return;
    }
    printf("taken station=%s sequence=%" PRIu64 " status=%" PRIu32 " cycle=%" PRIu64 " age_ns=%" PRIu64
           " valid=%" PRIu64 " usable=%" PRIu32 " worst_joint=%" PRIu32 " level_21=%u torque_21_z=%.3f reach=%.3f "
           "dose=%.3f\n",
           one->station, one->sequence, one->status, one->cycle, one->age_ns, one->valid, one->usable,
           one->worst_joint, one->joint_level[21], (double)one->torque_nm[21][2], (double)one->reach_m,
           (double)one->dose_probability);
}

/* Takes all that waits in the socket; *last is the newest then. */
static void take_all(int receiver, equipoise_udp_reader *reader, equipoise_udp_datagram *last, int each) {
    /* Somebody who sends faster than this reads must not keep it here; the age is right all the same. */
    for (int count = 0; count < 4096; count++) {
        uint8_t bytes[2048];
        const uint64_t asked_ns = now_ns();
        const ssize_t length = recv(receiver, bytes, sizeof bytes, MSG_DONTWAIT);
        if (length < 0) {
            if (errno == EAGAIN || errno == EWOULDBLOCK) {
                equipoise_udp_drained(reader, asked_ns);
            }
            return;
        }
        const int outcome = equipoise_udp_take(reader, bytes, (size_t)length, now_ns(), last);
        if (each) {
            print_each(outcome, last);
        }
    }
}

int main(int argc, char **argv) {
    struct sockaddr_in address = {.sin_family = AF_INET, .sin_addr.s_addr = htonl(INADDR_ANY)};
    equipoise_udp_reader reader;
    equipoise_udp_datagram last = {.status = EQUIPOISE_UDP_STATUS_SILENT};
    const int receiver = socket(AF_INET, SOCK_DGRAM, 0);
    if (argc < 4) {
        fprintf(stderr, "usage: udp_controller PORT STATION SECONDS [each]\n");
        return 2;
    }
    address.sin_port = htons((uint16_t)atoi(argv[1]));
    if (bind(receiver, (struct sockaddr *)&address, sizeof address) != 0) {
        perror("cannot take the port");
        return 1;
    }
    equipoise_udp_begin(&reader, argv[2]);
    const int each = argc > 4 && strcmp(argv[4], "each") == 0;
    const uint64_t end_ns = now_ns() + (uint64_t)(atof(argv[3]) * 1e9);
    uint64_t print_ns = now_ns() + UINT64_C(1000000000);
    socklen_t length = sizeof address;
    if (getsockname(receiver, (struct sockaddr *)&address, &length) != 0) {
        perror("cannot learn the port");
        return 1;
    }
    printf("listening on %u\n", (unsigned)ntohs(address.sin_port));
    fflush(stdout);
    while (now_ns() < end_ns) {
        struct pollfd ready = {.fd = receiver, .events = POLLIN};
        poll(&ready, 1, 10);
        take_all(receiver, &reader, &last, each);
        /* Command the robot's speed here, also when no datagram came. */
        if (!each && now_ns() >= print_ns) {
            print_line(&reader, &last);
            print_ns += UINT64_C(1000000000);
        }
        fflush(stdout);
    }
    close(receiver);
    printf("end ");
    print_line(&reader, &last);
    return 0;
}
