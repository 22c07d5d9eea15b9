/* What newtons.c needs of a board: registers, and a buffer that the DMAs reach.
 *
 * board_uio.c is for Linux on a board, board_socket.c for a simulated board. A slave is the core (0) or
 * axi_dma_k (k + 1). Each function ends the program with one line on standard error where it fails.
 */
#ifndef BOARD_H
#define BOARD_H

#include <stddef.h>
#include <stdint.h>

/* Connect; what `where` says depends on the board. */
void board_open(const char *where);
uint32_t board_read(unsigned slave, uint32_t offset);
void board_write(unsigned slave, uint32_t offset, uint32_t value);
/* The buffer's physical address, as the DMAs take it, and copies into it and out of it. */
uint64_t board_buffer(void);
void board_put(size_t offset, const void *octets, size_t count);
void board_get(size_t offset, void *octets, size_t count);
/* Let some time pass. */
void board_wait(void);

#endif
