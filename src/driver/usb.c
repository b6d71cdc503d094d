/* Finding, opening and closing USB boards, and what libusb's errors mean. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/text.h"
#include "driver/usb_priv.h"

#define UDEV_RULE "/etc/udev/rules.d/70-mechkit.rules"

/* --- errors ------------------------------------------------------------------------------------
 */

static const struct {
    int code;
    enum mk_status status;
    const char *text;
} errors[] = {
    {LIBUSB_ERROR_IO, MK_ERR_IO, "input/output error: check cable and hub"},
    {LIBUSB_ERROR_INVALID_PARAM, MK_ERR_INVALID, "invalid parameter"},
    {LIBUSB_ERROR_ACCESS, MK_ERR_PERM,
     "no permission: install the udev rule (docs/boards.md) as " UDEV_RULE
     ", join its group, plug the board in again"},
    {LIBUSB_ERROR_NO_DEVICE, MK_ERR_NODEV, "the board is gone: check plug and power"},
    {LIBUSB_ERROR_NOT_FOUND, MK_ERR_NOTFOUND, "not found"},
    {LIBUSB_ERROR_BUSY, MK_ERR_BUSY, "another program uses the board: close it first"},
    {LIBUSB_ERROR_TIMEOUT, MK_ERR_TIMEOUT, "no answer in time: switch the board off and on"},
    {LIBUSB_ERROR_OVERFLOW, MK_ERR_PROTO, "more data than asked for: is this a mechkit board?"},
    {LIBUSB_ERROR_PIPE, MK_ERR_PROTO, "the endpoint is halted"},
    {LIBUSB_ERROR_INTERRUPTED, MK_ERR_INTR, "interrupted"},
    {LIBUSB_ERROR_NO_MEM, MK_ERR_NOMEM, "out of memory"},
    {LIBUSB_ERROR_NOT_SUPPORTED, MK_ERR_NOTSUP, "not supported on this system"},
};

enum mk_status mk_usb_error(struct mk_error *err, int code, const char *doing)
{
    enum mk_status status = MK_ERR_IO;
    const char *text = "error of an unknown kind";
    for (size_t i = 0; i < sizeof errors / sizeof errors[0]; i++)
        if (errors[i].code == code) {
            status = errors[i].status;
            text = errors[i].text;
        }
    mk_error_set(err, status, "USB: cannot %s: %s (%s)", doing, text, libusb_error_name(code));
    if (err)
        err->os_code = code;
    return status;
}

/* --- which board is meant ----------------------------------------------------------------------
 */

struct wanted {
    unsigned vendor, product;
    const char *serial; /* "": any */
};

static bool four_hex(const char *text, unsigned *out)
{
    if (strspn(text, "0123456789abcdefABCDEF") != 4)
        return false;
    *out = (unsigned)strtoul(text, NULL, 16);
    return true;
}

/* SERIAL, VID:PID or VID:PID:SERIAL. */
static struct wanted parse_wanted(const char *device)
{
    struct wanted any = {MK_USB_VENDOR, MK_USB_PRODUCT, device ? device : ""}, w = any;
    if (!device || !four_hex(device, &w.vendor) || device[4] != ':' ||
        !four_hex(device + 5, &w.product))
        return any;
    if (device[9] == '\0')
        w.serial = "";
    else if (device[9] == ':')
        w.serial = device + 10;
    else
        return any;
    return w;
}

static bool is_wanted(libusb_device *device, const struct wanted *w,
                      struct libusb_device_descriptor *d)
{
    return libusb_get_device_descriptor(device, d) == LIBUSB_SUCCESS && d->idVendor == w->vendor &&
           d->idProduct == w->product;
}

/* As it may be shown. */
static void read_string(libusb_device_handle *handle, uint8_t index, char *out, size_t size)
{
    unsigned char text[128]; /* no descriptor is longer */
    int most = (int)sizeof text - 1;
    int n = index ? libusb_get_string_descriptor_ascii(handle, index, text, most) : 0;
    text[n > 0 ? n : 0] = '\0';
    mk_show_text(out, size, (const char *)text);
}

void mk_usb_place(char *out, size_t size, int bus, int address, const uint8_t *port, int depth)
{
    int n = snprintf(out, size, "bus %d device %d", bus, address);
    for (int i = 0; i < depth && (size_t)n < size; i++)
        n += snprintf(out + n, size - (size_t)n, "%s%d", i ? "." : " port ", port[i]);
}

/* --- opening -----------------------------------------------------------------------------------
 */

/* The first interface with a bulk endpoint each way. */
static bool find_endpoints(struct mk_usb *u, libusb_device *device)
{
    struct libusb_config_descriptor *config;
    if (libusb_get_active_config_descriptor(device, &config) != LIBUSB_SUCCESS)
        return false;
    const struct libusb_interface_descriptor *interface =
        config->bNumInterfaces > 0 && config->interface[0].num_altsetting > 0
            ? &config->interface[0].altsetting[0]
            : NULL;
    for (int i = 0; interface && i < interface->bNumEndpoints; i++) {
        const struct libusb_endpoint_descriptor *e = &interface->endpoint[i];
        if ((e->bmAttributes & LIBUSB_TRANSFER_TYPE_MASK) != LIBUSB_TRANSFER_TYPE_BULK)
            continue;
        if (e->bEndpointAddress & LIBUSB_ENDPOINT_IN)
            u->endpoint_in = e->bEndpointAddress;
        else
            u->endpoint_out = e->bEndpointAddress;
    }
    libusb_free_config_descriptor(config);
    return u->endpoint_in && u->endpoint_out;
}

/* Opens a device that may be the one; its serial number decides. LIBUSB_ERROR_NOT_FOUND: it is not.
 */
static int try_device(struct mk_usb *u, libusb_device *device, const struct wanted *w)
{
    struct libusb_device_descriptor d;
    if (!is_wanted(device, w, &d))
        return LIBUSB_ERROR_NOT_FOUND;
    int rc = libusb_open(device, &u->handle);
    if (rc != LIBUSB_SUCCESS)
        return rc;
    char serial[64] = "";
    if (w->serial[0])
        read_string(u->handle, d.iSerialNumber, serial, sizeof serial);
    if (strcmp(serial, w->serial) == 0)
        return LIBUSB_SUCCESS;
    libusb_close(u->handle);
    u->handle = NULL;
    return LIBUSB_ERROR_NOT_FOUND;
}

static enum mk_status open_wanted(struct mk_usb *u, const struct wanted *w, struct mk_error *err)
{
    libusb_device **list;
    ssize_t n = libusb_get_device_list(u->context, &list);
    if (n < 0)
        return mk_usb_error(err, (int)n, "list the devices");
    /* A board that cannot be opened is worth more of a message than one that is not there. */
    int rc = LIBUSB_ERROR_NOT_FOUND;
    for (ssize_t i = 0; i < n && rc != LIBUSB_SUCCESS; i++) {
        int tried = try_device(u, list[i], w);
        rc = tried == LIBUSB_ERROR_NOT_FOUND ? rc : tried;
    }
    libusb_free_device_list(list, 1);
    if (rc == LIBUSB_ERROR_NOT_FOUND)
        return mk_error_set(err, MK_ERR_NOTFOUND,
                            "no USB board %04x:%04x%s%s: is it plugged in and switched on? "
                            "`mechkit boards` lists what is there",
                            w->vendor, w->product, w->serial[0] ? " with serial number " : "",
                            w->serial);
    return rc == LIBUSB_SUCCESS ? MK_OK : mk_usb_error(err, rc, "open the board");
}

static enum mk_status claim(struct mk_usb *u, struct mk_error *err)
{
    /* A kernel driver that took the interface is put aside until the board is closed. */
    (void)libusb_set_auto_detach_kernel_driver(u->handle, 1);
    if (!find_endpoints(u, libusb_get_device(u->handle)))
        return mk_error_set(
            err, MK_ERR_NOTSUP,
            "the USB device has no bulk endpoints both ways: is it a mechkit board?");
    int rc = libusb_claim_interface(u->handle, 0);
    if (rc != LIBUSB_SUCCESS)
        return mk_usb_error(err, rc, "claim the board");
    u->claimed = true;
    return MK_OK;
}

static enum mk_status make_transfers(struct mk_usb *u, struct mk_error *err)
{
    u->write = libusb_alloc_transfer(0);
    bool all = u->write != NULL;
    for (int i = 0; i < MK_USB_READS; i++) {
        struct mk_usb_read *r = &u->read[i];
        r->usb = u;
        r->transfer = libusb_alloc_transfer(0);
        all = all && r->transfer;
        if (r->transfer)
            libusb_fill_bulk_transfer(r->transfer, u->handle, u->endpoint_in, r->bytes,
                                      sizeof r->bytes, mk_usb_read_done, r, 0);
    }
    if (!all)
        return mk_error_set(err, MK_ERR_NOMEM, "no memory for USB transfers");
    libusb_fill_bulk_transfer(u->write, u->handle, u->endpoint_out, u->write_bytes, 0,
                              mk_usb_write_done, u, 0);
    mk_usb_start_reads(u);
    return u->gone ? mk_usb_error(err, LIBUSB_ERROR_NO_DEVICE, "read from the board") : MK_OK;
}

static int LIBUSB_CALL on_unplug(libusb_context *context, libusb_device *device,
                                 libusb_hotplug_event event, void *user)
{
    struct mk_usb *u = user;
    (void)context;
    (void)event;
    if (u->handle && device == libusb_get_device(u->handle))
        u->gone = true;
    return 0;
}

/* With hotplug events an unplugged board is known to be gone even between transfers. */
static void watch_plug(struct mk_usb *u)
{
    if (!libusb_has_capability(LIBUSB_CAP_HAS_HOTPLUG))
        return;
    u->watching = libusb_hotplug_register_callback(
                      u->context, LIBUSB_HOTPLUG_EVENT_DEVICE_LEFT, 0, LIBUSB_HOTPLUG_MATCH_ANY,
                      LIBUSB_HOTPLUG_MATCH_ANY, LIBUSB_HOTPLUG_MATCH_ANY, on_unplug, u,
                      &u->watch) == LIBUSB_SUCCESS;
}

enum mk_status mk_usb_open(struct mk_usb *u, const char *device, struct mk_error *err)
{
    memset(u, 0, sizeof *u);
    u->write_done = 1;
    struct wanted w = parse_wanted(device);
    int rc = libusb_init(&u->context);
    if (rc != LIBUSB_SUCCESS)
        return mk_usb_error(err, rc, "start libusb");
    (void)libusb_set_option(u->context, LIBUSB_OPTION_LOG_LEVEL, LIBUSB_LOG_LEVEL_NONE);
    enum mk_status st = open_wanted(u, &w, err);
    if (st == MK_OK)
        st = claim(u, err);
    if (st == MK_OK)
        st = make_transfers(u, err);
    if (st == MK_OK)
        watch_plug(u);
    else
        mk_usb_close(u);
    return st;
}

void mk_usb_close(struct mk_usb *u)
{
    if (!u->context)
        return;
    if (u->watching)
        libusb_hotplug_deregister_callback(u->context, u->watch);
    bool ended = mk_usb_stop_transfers(u);
    for (int i = 0; i < MK_USB_READS && ended; i++)
        libusb_free_transfer(u->read[i].transfer);
    if (ended)
        libusb_free_transfer(u->write);
    if (u->claimed)
        (void)libusb_release_interface(u->handle, 0);
    if (u->handle)
        libusb_close(u->handle);
    libusb_exit(u->context);
    u->context = NULL;
    u->handle = NULL;
}

/* --- listing -----------------------------------------------------------------------------------
 */

static void describe(libusb_device *device, const struct libusb_device_descriptor *d,
                     struct mk_board_found *out)
{
    libusb_device_handle *handle;
    struct mk_error err = MK_ERROR_INIT;
    uint8_t port[7]; /* as deep as hubs may be */
    *out = (struct mk_board_found){.status = MK_OK};
    int depth = libusb_get_port_numbers(device, port, sizeof port);
    mk_usb_place(out->where, sizeof out->where, libusb_get_bus_number(device),
                 libusb_get_device_address(device), port, depth);
    snprintf(out->device, sizeof out->device, "%04x:%04x", d->idVendor, d->idProduct);
    int rc = libusb_open(device, &handle);
    if (rc == LIBUSB_SUCCESS) {
        char serial[48] = "";
        read_string(handle, d->iProduct, out->name, sizeof out->name);
        read_string(handle, d->iSerialNumber, serial, sizeof serial);
        if (serial[0])
            snprintf(out->device, sizeof out->device, "%s", serial);
        (void)libusb_set_auto_detach_kernel_driver(handle, 1);
        rc = libusb_claim_interface(handle, 0);
        if (rc == LIBUSB_SUCCESS)
            (void)libusb_release_interface(handle, 0);
        libusb_close(handle);
    }
    if (rc != LIBUSB_SUCCESS) {
        out->status = mk_usb_error(&err, rc, "open the board");
        snprintf(out->note, sizeof out->note, "%.255s", err.message);
    }
}

int mk_usb_find(const char *device, struct mk_board_found *out, int max, struct mk_error *err)
{
    struct wanted w = parse_wanted(device);
    struct libusb_device_descriptor d;
    libusb_context *context;
    libusb_device **list;
    int rc = libusb_init(&context), found = 0;
    if (rc != LIBUSB_SUCCESS)
        return mk_usb_error(err, rc, "start libusb");
    (void)libusb_set_option(context, LIBUSB_OPTION_LOG_LEVEL, LIBUSB_LOG_LEVEL_NONE);
    ssize_t n = libusb_get_device_list(context, &list);
    for (ssize_t i = 0; i < n; i++)
        if (is_wanted(list[i], &w, &d)) {
            if (found < max)
                describe(list[i], &d, &out[found]);
            found++;
        }
    if (n >= 0)
        libusb_free_device_list(list, 1);
    libusb_exit(context);
    return n < 0 ? mk_usb_error(err, (int)n, "list the devices") : found;
}
