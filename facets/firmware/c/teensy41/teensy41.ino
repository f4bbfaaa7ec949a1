/* Teensy 4.1: reads twelve converter channels, solves the mirror's pose, sends both as frames.
 *
 * Copy facets.c, facets.h, facets_frame.c and facets_frame.h beside this file (`make teensy`).
 * What depends on your board is in the two functions marked STUB. It was not tried on hardware.
 */
#include "facets_frame.h"

static const uint32_t PERIOD_US = 100; /* 10 kHz */
static const uint32_t PATIENCE_US = 100000; /* without a heartbeat, until the stage is stopped */
static const int PERMIT_PIN = 3;       /* high: the stage may move; pull it down */
static const int ENABLE_PIN = 4;       /* toggles while it may: for a monostable and a relay */
static facets_real DARK[12];           /* counts without light; fill from a dark measurement */

static facets_options options;
static facets_real last[9];
static bool warm = false;
static uint32_t seq = 0, missed = 0;
static elapsedMicros since;
static facets_heartbeat heartbeat; /* zero */
static bool level = false;

/* STUB: starts your converters. */
static void start_converters() {}

/* STUB: one reading of each electrode, four for each detector, in the order of the frames. */
static void read_converters(int32_t counts[12]) {
  for (int n = 0; n < 12; n++) counts[n] = 0;
}

void setup() {
  Serial.begin(2000000); /* USB: the number does not matter */
  start_converters();
  pinMode(PERMIT_PIN, INPUT_PULLDOWN);
  pinMode(ENABLE_PIN, OUTPUT);
  facets_default_options(&options);
  options.covariance = 0;
  since = 0;
}

void loop() {
  if (since < PERIOD_US) return;
  if (since >= 2 * PERIOD_US) missed++; /* told by the flag of the next frame */
  since -= PERIOD_US;
  const uint32_t time = micros();

  while (Serial.available()) facets_heartbeat_feed(&heartbeat, (uint8_t)Serial.read(), micros());
  if (facets_heartbeat_is_alive(&heartbeat, micros(), PATIENCE_US)) {
    level = !level; /* a sketch that hangs toggles nothing, either */
    digitalWrite(ENABLE_PIN, level);
  }

  int32_t counts[12];
  read_converters(counts);
  const uint8_t flags = (uint8_t)((missed ? FACETS_FRAME_OVERRUN : 0) |
                                  (digitalRead(PERMIT_PIN) ? FACETS_FRAME_PERMIT : 0));

  facets_real reading[9];
  facets_solution solution;
  facets_from_counts(counts, DARK, 0, reading);
  facets_solve(reading, warm ? last : NULL, &options, &solution);
  if (solution.status != FACETS_CONVERGED && warm) facets_solve(reading, NULL, &options, &solution);
  const uint32_t took = micros() - time;
  warm = solution.status == FACETS_CONVERGED;
  if (warm) {
    for (int n = 0; n < 8; n++) last[n] = solution.state[n];
    last[8] = solution.power;
  }

  uint8_t frames[2 * FACETS_FRAME_SIZE];
  facets_frame_counts(frames, FACETS_FRAME_ELECTRODES, flags, seq, time, counts);
  facets_frame_pose(frames + FACETS_FRAME_SIZE, seq, time, &solution,
                    took > 65535 ? 65535 : (uint16_t)took);
  if (Serial.availableForWrite() >= (int)sizeof frames) {
    Serial.write(frames, sizeof frames);
    missed = 0;
  } else {
    missed++; /* a PC that does not read must not hold the loop */
  }
  seq++;
}
