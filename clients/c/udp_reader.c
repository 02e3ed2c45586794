/* Takes the datagrams of the UDP gateway; see equipoise_udp.h. Standard C, nothing of the system. */
#include "equipoise_udp.h"

#include <string.h>

/* Without a datagram for so long any session is taken. */
static const uint64_t FORGET_AFTER_NS = UINT64_C(1000000000);
/* Two machines' clocks may run apart by one part in so many; two that NTP does not hold, by less. */
static const int64_t DRIFT_PARTS = 5000;

static uint64_t number(const uint8_t *bytes, size_t count) {
    uint64_t value = 0;
    while (count-- > 0) {
        value = value << 8 | bytes[count];
    }
    return value;
}

/* CRC-32 of Ethernet: reflected polynomial 0xEDB88320, all ones before and after. */
static uint32_t crc32(const uint8_t *bytes, size_t count) {
    uint32_t crc = UINT32_C(0xFFFFFFFF);
    for (size_t at = 0; at < count; at++) {
        crc ^= bytes[at];
        for (int bit = 0; bit < 8; bit++) {
            crc = crc >> 1 ^ (crc & 1 ? UINT32_C(0xEDB88320) : 0);
        }
    }
    return ~crc;
}

static void read_char(char *to, const uint8_t *from, size_t count) {
    memcpy(to, from, count);
    to[count] = '\0';
}

static void read_u8(uint8_t *to, const uint8_t *from, size_t count) { memcpy(to, from, count); }

static void read_u16(uint16_t *to, const uint8_t *from, size_t count) {
    for (size_t at = 0; at < count; at++) {
        to[at] = (uint16_t)number(from + 2 * at, 2);
    }
}

static void read_u32(uint32_t *to, const uint8_t *from, size_t count) {
    for (size_t at = 0; at < count; at++) {
        to[at] = (uint32_t)number(from + 4 * at, 4);
    }
}

static void read_u64(uint64_t *to, const uint8_t *from, size_t count) {
    for (size_t at = 0; at < count; at++) {
        to[at] = number(from + 8 * at, 8);
    }
}

static void read_f32(float *to, const uint8_t *from, size_t count) {
    for (size_t at = 0; at < count; at++) {
        const uint32_t bits = (uint32_t)number(from + 4 * at, 4);
        memcpy(&to[at], &bits, sizeof bits);
    }
}

static void decode(const uint8_t *bytes, equipoise_udp_datagram *to) {
#define FIELD(kind, name, count, offset) read_##kind((void *)&to->name, bytes + (offset), (count));
    EQUIPOISE_UDP_FIELDS(FIELD)
#undef FIELD
}

static int is_later(const equipoise_udp_reader *reader, const equipoise_udp_datagram *datagram, uint64_t now_ns) {
    if (reader->taken == 0 || now_ns - reader->taken_at_ns >= FORGET_AFTER_NS) {
        return 1;
    }
    if (datagram->session_ns != reader->session_ns) {
        return datagram->session_ns > reader->session_ns;
    }
    return datagram->sequence > reader->sequence;
}

static int judge(const equipoise_udp_reader *reader, const uint8_t *bytes, size_t length, uint64_t now_ns,
                 equipoise_udp_datagram *read) {
    if (length < 8) {
        return EQUIPOISE_UDP_LENGTH;
    }
    if (memcmp(bytes, EQUIPOISE_UDP_MAGIC, 4) != 0) {
        return EQUIPOISE_UDP_MAGIC_WRONG;
    }
    if (number(bytes + 4, 2) != EQUIPOISE_UDP_VERSION) {
        return EQUIPOISE_UDP_OTHER_VERSION;
    }
    if (length != EQUIPOISE_UDP_BYTES || number(bytes + 6, 2) != length) {
        return EQUIPOISE_UDP_LENGTH;
    }
    if (crc32(bytes, EQUIPOISE_UDP_BYTES - 4) != number(bytes + EQUIPOISE_UDP_BYTES - 4, 4)) {
        return EQUIPOISE_UDP_CRC_WRONG;
    }
    decode(bytes, read);
    if (reader->station != NULL && strcmp(reader->station, read->station) != 0) {
        return EQUIPOISE_UDP_OTHER_STATION;
    }
    return is_later(reader, read, now_ns) ? EQUIPOISE_UDP_TAKEN : EQUIPOISE_UDP_OLD;
}

/* Lateness of a datagram. The offset of this clock from the station's is unknown, but bounded: a datagram cannot arrive
 * before it was sent, and has waited in the socket at most since that was last empty. The lateness is relative to the
 * lower bound.
 */
static void measure(equipoise_udp_reader *reader, const equipoise_udp_datagram *read, uint64_t now_ns) {
    const int64_t apart_ns = (int64_t)(now_ns - read->state_time_ns - read->age_ns);
    const int64_t least_ns = (int64_t)((uint64_t)apart_ns - (now_ns - reader->drained_at_ns));
    if (!reader->bounded || read->session_ns != reader->session_ns) {
        reader->ahead_max_ns = apart_ns;
        reader->ahead_min_ns = least_ns;
    } else {
        reader->ahead_max_ns += (int64_t)(now_ns - reader->bounded_at_ns) / DRIFT_PARTS;
    }
    if (apart_ns < reader->ahead_max_ns) {
        reader->ahead_max_ns = apart_ns;
    }
    if (least_ns > reader->ahead_min_ns) {
        reader->ahead_min_ns = least_ns;
    }
    if (reader->ahead_min_ns > reader->ahead_max_ns) {
        reader->ahead_min_ns = reader->ahead_max_ns; /* It was late on the network. */
    }
    reader->bounded = 1;
    reader->bounded_at_ns = now_ns;
    reader->late_ns = (uint64_t)apart_ns - (uint64_t)reader->ahead_min_ns;
}

void equipoise_udp_begin(equipoise_udp_reader *reader, const char *station) {
    memset(reader, 0, sizeof *reader);
    reader->station = station;
}

void equipoise_udp_drained(equipoise_udp_reader *reader, uint64_t now_ns) { reader->drained_at_ns = now_ns; }

int equipoise_udp_take(equipoise_udp_reader *reader, const void *bytes, size_t length, uint64_t now_ns,
                       equipoise_udp_datagram *datagram) {
    equipoise_udp_datagram read;
    const int outcome = judge(reader, bytes, length, now_ns, &read);
    if (outcome != EQUIPOISE_UDP_TAKEN) {
        reader->refused[outcome]++;
        return outcome;
    }
    if (reader->taken > 0 && read.session_ns == reader->session_ns && read.sequence > reader->sequence) {
        reader->missed += read.sequence - reader->sequence - 1;
    }
    if (read.status == EQUIPOISE_UDP_STATUS_CURRENT) {
        measure(reader, &read, now_ns);
    } else if (read.session_ns != reader->session_ns) {
        reader->bounded = 0;
    }
    reader->session_ns = read.session_ns;
    reader->sequence = read.sequence;
    reader->taken_at_ns = now_ns;
    reader->taken++;
    *datagram = read;
    return EQUIPOISE_UDP_TAKEN;
}

uint64_t equipoise_udp_age_ns(const equipoise_udp_reader *reader, const equipoise_udp_datagram *datagram,
                              uint64_t now_ns) {
    const uint64_t since_ns = now_ns - reader->taken_at_ns;
    if (reader->taken == 0 || datagram->status != EQUIPOISE_UDP_STATUS_CURRENT) {
        return UINT64_MAX;
    }
    if (reader->late_ns > UINT64_MAX - since_ns || datagram->age_ns > UINT64_MAX - since_ns - reader->late_ns) {
        return UINT64_MAX;
    }
    return datagram->age_ns + reader->late_ns + since_ns;
}

const char *equipoise_udp_outcome_name(int outcome) {
    static const char *const NAMES[] = {"taken", "length", "magic", "version", "crc", "station", "old"};
    return outcome >= 0 && outcome < (int)(sizeof NAMES / sizeof NAMES[0]) ? NAMES[outcome] : "unknown";
}
