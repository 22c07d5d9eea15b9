/* Linux on a board: UIO devices fastac_0 and axi_dma_0 by their names in /sys/class/uio, and the buffer WHERE of
 * u-dma-buf, such as udmabuf0. Tested against files that stand in for these, never on a board.
 */
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#include "board.h"

#ifndef SYS
#define SYS "/sys/class"
#define DEV "/dev"
#endif
#define SLAVES 2
#define DEVICES 32
#define TEXT 512

static const char *const names[SLAVES] = {"fastac_0", "axi_dma_0"};
static volatile uint32_t *slaves[SLAVES];
static volatile uint8_t *buffer;
static uint64_t buffer_address;
static char buffer_files[TEXT];

static void fail(const char *what)
{
    perror(what);
    exit(1);
}

/* The first line of a file, without its end; 0 where there is none. */
static int line(const char *path, char *text)
{
    FILE *file = fopen(path, "r");
    int there = file && fgets(text, TEXT, file);

    if (file)
        fclose(file);
    if (there)
        text[strcspn(text, "\n")] = 0;
    return there;
}

static uint64_t number(const char *path)
{
    char text[TEXT];

    if (!line(path, text))
        fail(path);
    return strtoull(text, NULL, 0);
}

static void *map(const char *path, size_t size)
{
    int file = open(path, O_RDWR | O_SYNC);
    void *found = file < 0 ? MAP_FAILED : mmap(NULL, size, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);

    if (found == MAP_FAILED)
        fail(path);
    close(file);
    return found;
}

void board_open(const char *where)
{
    char path[TEXT], text[TEXT];

    for (int k = 0; k < DEVICES; k++) {
        snprintf(path, sizeof path, SYS "/uio/uio%d/name", k);
        if (!line(path, text))
            continue;
        for (int slave = 0; slave < SLAVES; slave++) {
            if (strcmp(text, names[slave]))
                continue;
            snprintf(path, sizeof path, SYS "/uio/uio%d/maps/map0/size", k);
            size_t size = number(path);
            snprintf(path, sizeof path, DEV "/uio%d", k);
            slaves[slave] = map(path, size);
        }
    }
    for (int slave = 0; slave < SLAVES; slave++) {
        if (!slaves[slave]) {
            fprintf(stderr, "board: " SYS "/uio: no device %s\n", names[slave]);
            exit(1);
        }
    }
    snprintf(buffer_files, sizeof buffer_files, SYS "/u-dma-buf/%.64s", where);
    snprintf(path, sizeof path, "%.256s/phys_addr", buffer_files);
    buffer_address = number(path);
    snprintf(path, sizeof path, "%.256s/size", buffer_files);
    size_t size = number(path);
    snprintf(path, sizeof path, DEV "/%.64s", where);
    buffer = map(path, size); /* O_SYNC: not cached */
}

uint32_t board_read(unsigned slave, uint32_t offset)
{
    return slaves[slave][offset / 4];
}

void board_write(unsigned slave, uint32_t offset, uint32_t value)
{
    slaves[slave][offset / 4] = value;
}

uint64_t board_buffer(void)
{
    return buffer_address;
}

void board_put(size_t offset, const void *octets, size_t count)
{
    const uint8_t *from = octets;

    for (size_t k = 0; k < count; k++)
        buffer[offset + k] = from[k];
}

void board_get(size_t offset, void *octets, size_t count)
{
    uint8_t *to = octets;

    for (size_t k = 0; k < count; k++)
        to[k] = buffer[offset + k];
}

void board_wait(void)
{
    usleep(10);
}
