#include <errno.h>
#include <string.h>

#include "emu/usb.h"

/* Vendor class, strings 1 2 3. */
static const uint8_t device[] = {18,
                                 1,
                                 0x00,
                                 0x02,
                                 0xff,
                                 0,
                                 0,
                                 64,
                                 EMU_USB_VENDOR & 255,
                                 EMU_USB_VENDOR >> 8,
                                 EMU_USB_PRODUCT & 255,
                                 EMU_USB_PRODUCT >> 8,
                                 0,
                                 1,
                                 1,
                                 2,
                                 3,
                                 1};

/* Configuration, interface, bulk out, bulk in. */
static const uint8_t configuration[] = {9, 2, 32,          0, 1,    1,    0, 0xc0, 50, /**/
                                        9, 4, 0,           0, 2,    0xff, 0, 0,    0,  /**/
                                        7, 5, EMU_USB_OUT, 2, 0x00, 2,    0,           /**/
                                        7, 5, EMU_USB_IN,  2, 0x00, 2,    0};

static int string_descriptor(const struct emu_usb *u, int index, uint8_t *out, size_t size)
{
    const char *const text[] = {"", "mechkit", "emulated board", u->serial};
    size_t n = 2;
    if (index > 3)
        return -EPIPE;
    if (index == 0) {
        out[n++] = 0x09; /* English, United States */
        out[n++] = 0x04;
    }
    for (const char *c = text[index]; *c && n + 2 <= size; c++) {
        out[n++] = (uint8_t)*c;
        out[n++] = 0;
    }
    out[0] = (uint8_t)n;
    out[1] = 3;
    return (int)n;
}

int emu_usb_descriptor(const struct emu_usb *u, int type, int index, uint8_t *out, size_t size)
{
    size_t n = 0;
    if (type == 3)
        return string_descriptor(u, index, out, size);
    if (type > 2)
        return -EPIPE;
    if (type != 2) {
        memcpy(out, device, sizeof device);
        n = sizeof device;
    }
    if (type != 1) {
        memcpy(out + n, configuration, sizeof configuration);
        n += sizeof configuration;
    }
    return (int)n;
}
