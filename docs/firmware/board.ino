// Reference firmware for a detector board: twelve electrode currents as fixed 64-byte frames, and
// four bytes more for each auxiliary channel, such as a force.
// For a Teensy 4.x or another board with fast USB serial; README.md, "Formats", has the bytes.
// Reads three four-channel converters; replace `convert` by what yours need.

#include <Arduino.h>

constexpr uint32_t PERIOD_US = 100;      // 10 kHz
constexpr uint8_t ELECTRODES = 1;        // kind: counts of the electrodes; 2 is X, Y, SUM, spare
constexpr uint8_t CHANNELS = 0;          // auxiliary channels, as many as acquire.channels names; up to 15
constexpr uint8_t OVERRUN = 1, SATURATED = 2, MARK = 4, PERMIT = 8;
constexpr int MARK_PIN = 2;              // a pulse per second, or a trigger; -1 for none
constexpr int PERMIT_PIN = 3;            // high: the stage may move; pulled down, so that a cut wire stops
constexpr int ENABLE_PIN = 4;            // toggles while a PC that lives lets the stage move
constexpr uint32_t PATIENCE_US = 100000; // without a heartbeat
constexpr int32_t TOP = 65535;           // of a 16-bit converter

struct __attribute__((packed)) Frame {   // little-endian, as ARM is
  uint8_t sync[2];
  uint8_t kind, flags;
  uint32_t seq, time_us;
  int32_t counts[12];                    // A, B, C; each -y, +y, -z, +z
  float channels[CHANNELS];              // counts or volts; NAN where there is no value
  uint32_t crc;                          // CRC-32 (zlib, Ethernet) of the bytes before it
};
static_assert(sizeof(Frame) == 64 + 4 * CHANNELS, "no gaps");

static uint32_t table[256];
static uint32_t next_us, seq;
static bool lost, level, alive;
static uint8_t heard[12];                // a heartbeat: A5 5A, 4, flags, count, CRC-32 of these 8
static int held;
static uint32_t heard_us, beat;
static volatile bool marked;

static void on_mark() { marked = true; }

static void make_table() {
  for (uint32_t n = 0; n < 256; n++) {
    uint32_t c = n;
    for (int k = 0; k < 8; k++) c = c & 1 ? 0xEDB88320u ^ (c >> 1) : c >> 1;
    table[n] = c;
  }
}

static uint32_t crc32(const uint8_t *data, size_t size) {
  uint32_t c = 0xFFFFFFFFu;
  while (size--) c = table[(c ^ *data++) & 255] ^ (c >> 8);
  return ~c;
}

static void hear(uint8_t byte) {
  heard[held++] = byte;
  if (held == 2 && byte != 0x5A) heard[0] = heard[--held];
  if (held == 1 && heard[0] != 0xA5) held = 0;
  if (held < 12) return;
  held = 0;
  uint32_t number, crc;
  memcpy(&number, heard + 4, 4);
  memcpy(&crc, heard + 8, 4);
  if (heard[2] != 4 || crc != crc32(heard, 8) || number == beat) return;
  beat = number;
  heard_us = micros();
  alive = heard[3] & 1;                  // the stage may move
}

static int32_t convert(int channel) {    // your converter here
  return analogRead(channel);
}

static float auxiliary(int channel) {    // and here
  return analogRead(12 + channel);
}

void setup() {
  make_table();
  Serial.begin(3000000);
  if (MARK_PIN >= 0) attachInterrupt(digitalPinToInterrupt(MARK_PIN), on_mark, RISING);
  pinMode(PERMIT_PIN, INPUT_PULLDOWN);
  pinMode(ENABLE_PIN, OUTPUT);
  next_us = micros() + PERIOD_US;
}

void loop() {
  if (int32_t(micros() - next_us) < 0) return;
  Frame f = {{0xA5, 0x5A}, ELECTRODES | CHANNELS << 4, 0, seq++, micros(), {}, {}, 0};
  next_us += PERIOD_US;
  while (Serial.available()) hear(Serial.read());
  if (micros() - heard_us > PATIENCE_US) alive = false;
  if (alive) digitalWrite(ENABLE_PIN, level = !level);  // a board that hangs toggles nothing
  if (digitalRead(PERMIT_PIN)) f.flags |= PERMIT;
  for (int k = 0; k < 12; k++) {
    f.counts[k] = convert(k);
    if (f.counts[k] >= TOP) f.flags |= SATURATED;
  }
  for (int n = 0; n < CHANNELS; n++) f.channels[n] = auxiliary(n);
  if (marked) {                          // an edge since the sample before this one
    marked = false;
    f.flags |= MARK;
  }
  if (lost) f.flags |= OVERRUN;
  f.crc = crc32(reinterpret_cast<uint8_t *>(&f), sizeof f - 4);
  if (Serial.availableForWrite() < int(sizeof f)) {  // never wait: a sample lost is counted
    lost = true;
    return;
  }
  lost = false;
  Serial.write(reinterpret_cast<uint8_t *>(&f), sizeof f);
}
