/* The table of back ends: an explicit list, so that reading it tells what there is. */
#include "driver/backends.h"

#include <string.h>

static const struct mk_board_ops *const backends[] = {
    &mk_board_virtual_ops, &mk_board_usb_ops,    &mk_board_parport_ops,
    &mk_board_tcp_ops,     &mk_board_serial_ops, &mk_board_null_ops,
};
#define BACKEND_COUNT ((int)(sizeof backends / sizeof backends[0]))

const struct mk_board_ops *mk_board_backend(int index)
{
    return index >= 0 && index < BACKEND_COUNT ? backends[index] : NULL;
}

const struct mk_board_ops *mk_board_backend_by_name(const char *name)
{
    for (int i = 0; i < BACKEND_COUNT; i++)
        if (strcmp(backends[i]->name, name) == 0)
            return backends[i];
    return NULL;
}
