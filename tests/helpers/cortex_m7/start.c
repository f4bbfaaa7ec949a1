/* Starts a program on QEMU's board mps2-an500 (Cortex-M7), with semihosting for its output. */
#include <stdint.h>

extern uint32_t stack_top;
void _start(void);

static void reset(void)
{
    *(volatile uint32_t *)0xe000ed88u |= 0xfu << 20; /* the floating-point unit on */
    __asm volatile("dsb\n isb");
    _start();
}

static void fault(void)
{
    /* semihosting's exit, with the reason of an abort */
    __asm volatile("mov r0, #0x18\n mov r1, #0\n bkpt #0xab");
    for (;;) {
    }
}

__attribute__((section(".vectors"), used)) static void *const vectors[16] = {
    &stack_top, (void *)reset, (void *)fault, (void *)fault, (void *)fault, (void *)fault,
};
