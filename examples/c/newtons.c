/* One frame through the hardware, and the force on the fingertip out of its record.
 *
 *     newtons WHERE FRAME
 *
 * FRAME is a file with one frame as it lies in memory: FASTAC_FRAME_BYTES bytes, rows of pixels, their
 * channels padded to a power of two. fastac_registers.h is what `fastac registers` writes for the bundle.
 */
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "board.h"
#include "fastac_registers.h"

#ifdef FASTAC_DEPTH_PACKET_BYTES
#define PACKET_BYTES FASTAC_DEPTH_PACKET_BYTES
#define RECORD_AT FASTAC_DEPTH_TRAILER_OFFSET_BYTES
#else /* a scene without images: its packets are records */
#define PACKET_BYTES FASTAC_RECORD_BYTES
#define RECORD_AT 0
#endif

enum { CORE = 0, DMA = 1 };
/* AXI DMA, PG021: registers of the direction to the stream; those of the other one are 0x30 further on. */
enum { MM2S = 0x00, S2MM = 0x30, DMACR = 0x00, DMASR = 0x04, ADDRESS = 0x18, ADDRESS_MSB = 0x1c, LENGTH = 0x28 };
enum { RUN = 1u << 0, RESET = 1u << 2, HALTED = 1u << 0, IOC = 1u << 12, ERRORS = 0x70 };
#define PAGE 4096u
#define PATIENCE 100000

static void fail(const char *what, uint32_t found, uint32_t expected)
{
    fprintf(stderr, "newtons: %s = 0x%08" PRIx32 ": expected 0x%08" PRIx32 "\n", what, found, expected);
    exit(1);
}

static void expect(const char *what, uint32_t offset, uint32_t expected)
{
    uint32_t found = board_read(CORE, offset);

    if (found != expected)
        fail(what, found, expected);
}

/* Wait until bits of a register are as they should be. */
static uint32_t wait_for(unsigned slave, uint32_t offset, uint32_t mask, uint32_t expected, const char *what)
{
    uint32_t value = board_read(slave, offset);

    for (int k = 0; (value & mask) != expected; k++) {
        if (k == PATIENCE)
            fail(what, value, expected);
        board_wait();
        value = board_read(slave, offset);
    }
    return value;
}

static void transfer(uint32_t direction, uint64_t address, uint32_t length)
{
    board_write(DMA, direction + DMACR, RUN);
    wait_for(DMA, direction + DMASR, HALTED, 0, "DMASR.Halted");
    board_write(DMA, direction + ADDRESS, (uint32_t)address);
    board_write(DMA, direction + ADDRESS_MSB, (uint32_t)(address >> 32));
    board_write(DMA, direction + LENGTH, length); /* begins it */
}

static void finish(uint32_t direction, const char *what)
{
    uint32_t status = wait_for(DMA, direction + DMASR, IOC, IOC, what);

    if (status & ERRORS)
        fail(what, status, IOC);
}

int main(int count, char **arguments)
{
    static uint8_t frame[FASTAC_FRAME_BYTES];
    struct fastac_record record;
    uint32_t packet_at = (FASTAC_FRAME_BYTES + PAGE - 1) / PAGE * PAGE;
    FILE *file;

    if (count != 3) {
        fprintf(stderr, "usage: %s WHERE FRAME\n", arguments[0]);
        return 2;
    }
    file = fopen(arguments[2], "rb");
    if (!file || fread(frame, 1, sizeof frame, file) != sizeof frame) {
        fprintf(stderr, "newtons: %s: expected a file of %u bytes\n", arguments[2], FASTAC_FRAME_BYTES);
        return 1;
    }
    fclose(file);

    board_open(arguments[1]);
    expect("ID", FASTAC_ID_OFFSET, FASTAC_ID_RESET);
    expect("VERSION", FASTAC_VERSION_OFFSET, FASTAC_HARDWARE_VERSION);
    board_write(CORE, FASTAC_CONTROL_OFFSET, FASTAC_CONTROL_ENABLE_MASK);

    board_write(DMA, MM2S + DMACR, RESET); /* of both directions */
    wait_for(DMA, MM2S + DMACR, RESET, 0, "DMACR.Reset");
    transfer(S2MM, board_buffer() + packet_at, PACKET_BYTES);
    board_put(0, frame, sizeof frame);
    transfer(MM2S, board_buffer(), sizeof frame);
    finish(MM2S, "MM2S DMASR");
    finish(S2MM, "S2MM DMASR");

    board_get(packet_at + RECORD_AT, &record, sizeof record);
    if ((record.flags & FASTAC_RECORD_FORMAT_MASK) >> 8 != FASTAC_RECORD_FORMAT)
        fail("FLAGS", record.flags, FASTAC_RECORD_FORMAT << 8);
    printf("frame %" PRIu32 "%s%s%s, %" PRIu32 " clocks\n", record.frame,
           record.flags & FASTAC_RECORD_BAD_MASK ? " bad" : "",
           record.flags & FASTAC_RECORD_SUSPECT_MASK ? " suspect" : "",
           record.flags & FASTAC_RECORD_COMPLETE_MASK ? "" : " without a result", record.first_to_result);
#ifdef FASTAC_FORCE_X_N_PER_LSB
    printf("x %.9g N\n", (double)record.force_x * FASTAC_FORCE_X_N_PER_LSB);
#endif
#ifdef FASTAC_FORCE_Y_N_PER_LSB
    printf("y %.9g N\n", (double)record.force_y * FASTAC_FORCE_Y_N_PER_LSB);
#endif
#ifdef FASTAC_FORCE_Z_N_PER_LSB
    printf("z %.9g N\n", (double)record.force_z * FASTAC_FORCE_Z_N_PER_LSB);
#endif
    return 0;
}
