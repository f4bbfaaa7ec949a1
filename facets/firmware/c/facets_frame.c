#include "facets_frame.h"

#include <string.h>

static void put32(uint8_t *place, uint32_t value)
{
    int n;
    for (n = 0; n < 4; n++) place[n] = (uint8_t)(value >> (8 * n));
}

static void put_float(uint8_t *place, facets_real value)
{
    const float narrow = (float)value;
    uint32_t bits;
    memcpy(&bits, &narrow, sizeof bits);
    put32(place, bits);
}

/* The CRC-32 of Ethernet, ZIP and PNG. */
static uint32_t crc32(const uint8_t *bytes, int count)
{
    uint32_t crc = 0xffffffffu;
    int n, bit;
    for (n = 0; n < count; n++) {
        crc ^= bytes[n];
        for (bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ (0xedb88320u & (0u - (crc & 1u)));
    }
    return ~crc;
}

/* The checksum at the end of a frame. */
static void finish(uint8_t *frame)
{
    put32(frame + FACETS_FRAME_SIZE - 4, crc32(frame, FACETS_FRAME_SIZE - 4));
}

static void begin(uint8_t *frame, uint8_t kind, uint8_t flags, uint32_t seq, uint32_t time)
{
    int n;
    frame[0] = 0xa5;
    frame[1] = 0x5a;
    frame[2] = (uint8_t)(kind | FACETS_CHANNELS << 4);
    frame[3] = flags;
    put32(frame + 4, seq);
    put32(frame + 8, time);
    for (n = 0; n < FACETS_CHANNELS; n++) put32(frame + 60 + 4 * n, 0x7fc00000u); /* NaN */
}

void facets_frame_counts(uint8_t *frame, uint8_t kind, uint8_t flags, uint32_t seq, uint32_t time,
                         const int32_t *counts)
{
    int n;
    begin(frame, kind, flags, seq, time);
    for (n = 0; n < 12; n++) put32(frame + 12 + 4 * n, (uint32_t)counts[n]);
    finish(frame);
}

void facets_frame_channels(uint8_t *frame, const float *channels)
{
    int n;
    for (n = 0; n < FACETS_CHANNELS; n++) put_float(frame + 60 + 4 * n, (facets_real)channels[n]);
    finish(frame);
}

void facets_frame_pose(uint8_t *frame, uint32_t seq, uint32_t time,
                       const facets_solution *solution, uint16_t microseconds)
{
    int n;
    begin(frame, FACETS_FRAME_POSE, 0, seq, time);
    for (n = 0; n < 8; n++) put_float(frame + 12 + 4 * n, solution->state[n]);
    put_float(frame + 44, solution->power);
    put_float(frame + 48, solution->residual);
    frame[52] = (uint8_t)solution->status;
    frame[53] = (uint8_t)(solution->used[0] | solution->used[1] << 1 | solution->used[2] << 2);
    frame[54] = (uint8_t)solution->steps;
    frame[55] = 0;
    frame[56] = (uint8_t)(microseconds & 0xff);
    frame[57] = (uint8_t)(microseconds >> 8);
    frame[58] = frame[59] = 0;
    finish(frame);
}

static uint32_t get32(const uint8_t *place)
{
    return (uint32_t)place[0] | (uint32_t)place[1] << 8 | (uint32_t)place[2] << 16 |
           (uint32_t)place[3] << 24;
}

void facets_heartbeat_feed(facets_heartbeat *heartbeat, uint8_t byte, uint32_t now)
{
    uint8_t *bytes = heartbeat->bytes;
    bytes[heartbeat->held++] = byte;
    if (heartbeat->held == 2 && byte != 0x5a) {
        bytes[0] = byte;
        heartbeat->held = 1;
    }
    if (heartbeat->held == 1 && bytes[0] != 0xa5) heartbeat->held = 0;
    if (heartbeat->held < FACETS_HEARTBEAT_SIZE) return;
    heartbeat->held = 0;
    if (bytes[2] != FACETS_FRAME_HEARTBEAT || get32(bytes + 8) != crc32(bytes, 8)) return;
    if (get32(bytes + 4) == heartbeat->count) return; /* a frame that hangs is no sign of life */
    heartbeat->count = get32(bytes + 4);
    heartbeat->heard = now;
    heartbeat->alive = bytes[3] & 1u;
}

int facets_heartbeat_is_alive(facets_heartbeat *heartbeat, uint32_t now, uint32_t patience)
{
    if (now - heartbeat->heard > patience) heartbeat->alive = 0;
    return heartbeat->alive;
}
