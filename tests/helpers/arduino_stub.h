/* What the sketch asks of the Arduino environment, for a check of its syntax and types. */
#include <stddef.h>
#include <stdint.h>
uint32_t micros();
struct elapsedMicros {
  uint32_t value;
  elapsedMicros &operator=(uint32_t);
  elapsedMicros &operator-=(uint32_t);
  operator uint32_t() const;
};
struct Usb {
  void begin(long);
  int availableForWrite();
  size_t write(const uint8_t *, size_t);
};
extern Usb Serial;
