/* Every wrong call that can be detected is refused with an error text, and leaves no value that could be used. */
#include "equipoise.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MUST(condition)                                                                      \
    do {                                                                                     \
        if (!(condition)) {                                                                  \
            fprintf(stderr, "line %d: %s; it said: %s\n", __LINE__, #condition, equipoise_error()); \
            exit(1);                                                                         \
        }                                                                                    \
    } while (0)

static int says(const char *part) { return strstr(equipoise_error(), part) != NULL; }

static void nothing_is_left(const equipoise_reading *reading) {
    MUST(reading->state.valid == UINT64_MAX && reading->age_ns == UINT64_MAX);
    MUST(reading->sample_age_ns == UINT64_MAX && reading->state.cycle == 0 && reading->is_new == 0);
}

static void *elsewhere(void *consumer) {
    equipoise_reading reading;
    MUST(equipoise_next(consumer, 0, &reading) == EQUIPOISE_WRONG_USE && says("thread"));
    nothing_is_left(&reading);
    MUST(equipoise_latest(consumer, &reading) == EQUIPOISE_WRONG_USE);
    /* Never "", which says that it is published. */
    MUST(strstr(equipoise_report_refusal(consumer), "thread") != NULL && says("thread"));
    MUST(equipoise_close(consumer) == EQUIPOISE_WRONG_USE);
    return NULL;
}

int main(void) {
    const equipoise_options good = EQUIPOISE_OPTIONS_DEFAULT;
    equipoise_options bad = good;
    equipoise_consumer *consumer = (equipoise_consumer *)&bad;
    equipoise_reading reading;
    pthread_t thread;

    MUST(strcmp(equipoise_error(), "") == 0);
    MUST(equipoise_open("test", "c", &good, NULL) == EQUIPOISE_WRONG_USE && says("consumer is null"));
    MUST(equipoise_open(NULL, "c", &good, &consumer) == EQUIPOISE_WRONG_USE && says("station is null"));
    MUST(consumer == NULL);
    MUST(equipoise_open("test", NULL, &good, &consumer) == EQUIPOISE_WRONG_USE && says("name is null"));
    MUST(equipoise_open("test", "c", NULL, &consumer) == EQUIPOISE_WRONG_USE && says("options is null"));
    MUST(equipoise_open("test", "\xff", &good, &consumer) == EQUIPOISE_WRONG_USE && says("UTF-8"));
    MUST(equipoise_open("a/b", "c", &good, &consumer) == EQUIPOISE_BUS && says("is no name for a station"));
    bad.layout ^= 1;
    MUST(equipoise_open("test", "c", &bad, &consumer) == EQUIPOISE_WRONG_USE && says("another equipoise.h"));
    bad = good;
    bad.depth = 1000000;
    MUST(equipoise_open("test", "c", &bad, &consumer) == EQUIPOISE_BUS && says("choose 1 to"));
    MUST(consumer == NULL);

    MUST(equipoise_next(NULL, 0, &reading) == EQUIPOISE_WRONG_USE && says("consumer is null"));
    nothing_is_left(&reading);
    MUST(equipoise_latest(NULL, &reading) == EQUIPOISE_WRONG_USE);
    MUST(strstr(equipoise_report_refusal(NULL), "consumer is null") != NULL && says("consumer is null"));
    MUST(equipoise_close(NULL) == EQUIPOISE_OK);

    MUST(equipoise_open("test", "c", &good, &consumer) == EQUIPOISE_OK && consumer != NULL);
    MUST(equipoise_next(consumer, 0, NULL) == EQUIPOISE_WRONG_USE && says("reading is null"));
    MUST(equipoise_next(consumer, 0, &reading) == EQUIPOISE_SILENT && says("is the daemon running?"));
    nothing_is_left(&reading);
    MUST(equipoise_latest(consumer, &reading) == EQUIPOISE_SILENT);
    MUST(pthread_create(&thread, NULL, elsewhere, consumer) == 0 && pthread_join(thread, NULL) == 0);
    MUST(strcmp(equipoise_report_refusal(consumer), "") == 0);
    MUST(says("is the daemon running?")); /* Another thread's errors are its own. */
    MUST(strcmp(equipoise_reason_name(0), "suit_stale") == 0 && equipoise_reason_name(63) == NULL);
    MUST(equipoise_close(consumer) == EQUIPOISE_OK);
    printf("all refused\n");
    return 0;
}
