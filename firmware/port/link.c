// MAVLink 2 frames on the serial line. Bytes that belong to no valid frame of a known message are
// skipped one by one, so that a frame after garbage is found.
#define WITH_MESSAGES // the ids, sizes and checksum seeds of the dialect
#include <string.h>
#include "clock.h"
#include "hardware.h"
#include "link.h"
#include "uart.h"

#define MAGIC 0xFDu
#define HEADER 10u
#define CHECKSUM 2u
#define GAP_MS 20u // an incomplete frame is skipped after a longer pause
#define SYSTEM_ID 1u
#define COMPONENT_ID 1u

uint8_t link_in[PAYLOAD_BYTES];
uint8_t link_out[PAYLOAD_BYTES];
struct link_counts link_counts;

static uint8_t buffer[HEADER + PAYLOAD_BYTES + CHECKSUM];
static uint32_t count; // bytes in the buffer
static uint8_t sequence;

static uint16_t accumulate(uint16_t crc, uint8_t byte) {
    uint8_t mixed = (uint8_t)(byte ^ (crc & 0xFF));
    mixed ^= (uint8_t)(mixed << 4);
    return (uint16_t)((crc >> 8) ^ (mixed << 8) ^ (mixed << 3) ^ (mixed >> 4));
}

static uint16_t checksum(const uint8_t *bytes, uint32_t size, uint8_t seed) {
    uint16_t crc = 0xFFFF;
    for (uint32_t i = 0; i < size; i++) {
        crc = accumulate(crc, bytes[i]);
    }
    return accumulate(crc, seed);
}

static const struct message *message_of(uint32_t id) {
    for (uint32_t i = 0; i < MESSAGE_COUNT; i++) {
        if (messages[i].id == id) {
            return &messages[i];
        }
    }
    return 0;
}

static void drop(uint32_t bytes) {
    count -= bytes;
    memmove(buffer, buffer + bytes, count);
}

static void skip(void) {
    link_counts.skipped++;
    drop(1);
}

static uint32_t id_in(const uint8_t *frame) {
    return frame[7] | (uint32_t)frame[8] << 8 | (uint32_t)frame[9] << 16;
}

// Return the id of a whole frame at the start of the buffer, or 0 if bytes are missing.
static uint32_t parse(void) {
    while (count > 0) {
        const struct message *message = 0;
        if (buffer[0] != MAGIC || (count > 2 && buffer[2] != 0)) {
            skip();
            continue;
        }
        if (count < HEADER) {
            return 0;
        }
        message = message_of(id_in(buffer));
        uint32_t size = buffer[1];
        if (message == 0 || size == 0 || size > message->size) {
            skip();
            continue;
        }
        if (count < HEADER + size + CHECKSUM) {
            return 0;
        }
        uint16_t sum = checksum(buffer + 1, HEADER - 1 + size, message->seed);
        if (sum != (buffer[HEADER + size] | buffer[HEADER + size + 1] << 8)) {
            link_counts.refused++;
            skip();
            continue;
        }
        memcpy(link_in, buffer + HEADER, size);
        memset(link_in + size, 0, PAYLOAD_BYTES - size);
        drop(HEADER + size + CHECKSUM);
        return message->id;
    }
    return 0;
}

uint32_t link_receive(uint32_t ms) {
    static uint32_t resumed;
    uint32_t now = clock_now(), deadline = now + ms * TICKS_PER_MS, last = now;
    link_counts.busy += now - resumed;
    watchdog_clear();
    uint32_t id;
    for (;;) {
        int byte;
        while (count < sizeof buffer && (byte = uart_read()) >= 0) {
            buffer[count++] = (uint8_t)byte;
            last = clock_now();
        }
        id = parse();
        now = clock_now();
        if (id != 0 || (int32_t)(deadline - now) <= 0) {
            break;
        }
        if (count > 0 && now - last >= GAP_MS * TICKS_PER_MS) {
            skip();
            continue;
        }
        uint32_t until = count > 0 ? last + GAP_MS * TICKS_PER_MS : deadline;
        wait_until((int32_t)(until - deadline) < 0 ? until : deadline);
        watchdog_clear();
    }
    resumed = clock_now();
    if (id == TICK_INPUTS_ID) {
        mark_tick();
    }
    return id;
}

bool link_send(uint32_t id, uint32_t size) {
    static uint8_t frame[HEADER + PAYLOAD_BYTES + CHECKSUM];
    while (size > 1 && link_out[size - 1] == 0) {
        size--;
    }
    const uint8_t header[HEADER] = {
        MAGIC, (uint8_t)size, 0, 0, sequence++, SYSTEM_ID, COMPONENT_ID,
        (uint8_t)id, (uint8_t)(id >> 8), (uint8_t)(id >> 16),
    };
    memcpy(frame, header, HEADER);
    memcpy(frame + HEADER, link_out, size);
    const struct message *message = message_of(id);
    uint16_t sum = checksum(frame + 1, HEADER - 1 + size, message == 0 ? 0 : message->seed);
    frame[HEADER + size] = (uint8_t)sum;
    frame[HEADER + size + 1] = (uint8_t)(sum >> 8);
    bool sent = uart_write(frame, HEADER + size + CHECKSUM);
    link_counts.unsent += !sent;
    if (id == WHEEL_COMMAND_ID) {
        mark_command();
    }
    return sent;
}

__attribute__((noinline)) void mark_tick(void) {
    __asm volatile ("");
}

__attribute__((noinline)) void mark_command(void) {
    __asm volatile ("nop");
}
