/* The simulated board: WHERE is the socket of `python -m fastac.sim.board`, whose protocol is in
 * sim/board/protocol.py. Its memory begins at MEMORY; its clock runs only while a request is answered.
 */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "board.h"

#ifndef CORE_ADDRESS /* of a Zynq MPSoC; see gateware/target/block_design.py */
#define CORE_ADDRESS 0xa0000000u
#define DMA_ADDRESS 0xa0010000u
#endif
#define RANGE 0x10000u
#define MEMORY 0x10000000u
#define CLOCKS 200u

enum { READ = 1, WRITE, MEMORY_READ, MEMORY_WRITE, RUN };

struct request {
    uint32_t operation, argument;
    uint64_t address;
};

struct reply {
    uint32_t status, length;
    uint64_t value, clocks;
};

static int board = -1;

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

static void move(void *octets, size_t count, int out)
{
    char *at = octets;

    while (count) {
        ssize_t moved = out ? write(board, at, count) : read(board, at, count);

        if (moved <= 0)
            fail("board: the simulation has ended");
        at += moved;
        count -= (size_t)moved;
    }
}

/* One request with `out` bytes behind it; the answer's value, and its bytes to `data`. */
static uint64_t ask(uint32_t operation, uint32_t argument, uint64_t address, void *data, size_t out)
{
    struct request request = {operation, argument, address};
    struct reply reply;

    move(&request, sizeof request, 1);
    if (out)
        move(data, out, 1);
    move(&reply, sizeof reply, 0);
    if (reply.status) {
        char text[256] = "";

        move(text, reply.length < sizeof text ? reply.length : sizeof text - 1, 0);
        fprintf(stderr, "board: %s\n", text);
        exit(1);
    }
    if (reply.length)
        move(data, reply.length, 0);
    return reply.value;
}

static uint64_t place(unsigned slave, uint32_t offset)
{
    return (slave ? DMA_ADDRESS + (slave - 1) * RANGE : CORE_ADDRESS) + (uint64_t)offset;
}

void board_open(const char *where)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};

    strncpy(address.sun_path, where, sizeof address.sun_path - 1);
    board = socket(AF_UNIX, SOCK_STREAM, 0);
    if (board < 0 || connect(board, (struct sockaddr *)&address, sizeof address))
        fail(where);
}

uint32_t board_read(unsigned slave, uint32_t offset)
{
    return (uint32_t)ask(READ, 0, place(slave, offset), NULL, 0);
}

void board_write(unsigned slave, uint32_t offset, uint32_t value)
{
    ask(WRITE, value, place(slave, offset), NULL, 0);
}

uint64_t board_buffer(void)
{
    return MEMORY;
}

void board_put(size_t offset, const void *octets, size_t count)
{
    ask(MEMORY_WRITE, (uint32_t)count, MEMORY + offset, (void *)octets, count);
}

void board_get(size_t offset, void *octets, size_t count)
{
    ask(MEMORY_READ, (uint32_t)count, MEMORY + offset, octets, 0);
}

void board_wait(void)
{
    ask(RUN, CLOCKS, 0, NULL, 0);
}
