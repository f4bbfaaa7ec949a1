/* What the sketch asks of the Arduino environment, for a check of its syntax and types. */
#include <stddef.h>
#include <stdint.h>
uint32_t micros();
const int OUTPUT = 1, INPUT_PULLDOWN = 2;
void pinMode(int, int);
void digitalWrite(int, int);
int digitalRead(int);
struct elapsedMicros {
  uint32_t value;
  elapsedMicros &operator=(uint32_t);
  elapsedMicros &operator-=(uint32_t);
  operator uint32_t() const;
};
struct Usb {
  void begin(long);
  int available();
  int read();
  int availableForWrite();
  size_t write(const uint8_t *, size_t);
};
extern Usb Serial;
