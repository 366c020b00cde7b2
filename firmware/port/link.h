// MAVLink 2 frames on the serial line.
#include <stdbool.h>
#include <stdint.h>

#include "messages.h" // generated: PAYLOAD_BYTES, the size of the largest payload

extern uint8_t link_in[PAYLOAD_BYTES]; // payload of the last frame, filled up with zeros
extern uint8_t link_out[PAYLOAD_BYTES]; // payload of the next frame

struct link_counts {
    uint32_t skipped; // bytes outside of frames
    uint32_t refused; // frames with a wrong checksum
    uint32_t unsent; // frames that a stuck line did not take
    uint32_t busy; // time outside of waits, 25 MHz
};
extern struct link_counts link_counts;

uint32_t link_receive(uint32_t ms); // the id of the next frame, or 0 after this time
bool link_send(uint32_t id, uint32_t size);

// Empty functions whose addresses mark a measurement: a tick begins, its wheel command is sent. The
// tick ends with the next call of `link_receive`.
void mark_tick(void);
void mark_command(void);
