/* libusb with a board on it that does what the fuzzer's bytes say: descriptors, errors, transfers
 * that end well, badly, or not at all. */
#include <libusb.h>
#include <stdlib.h>
#include <string.h>

#include "wire_talk.h"

#define TRANSFERS 8
#define DEVICES 3

/* Nothing of it is looked into by anybody else. */
struct libusb_context {
    int number;
};
struct libusb_device {
    int number;
};
struct libusb_device_handle {
    struct libusb_device *device;
};

static struct libusb_context context;
static struct libusb_device device[DEVICES] = {{0}, {1}, {2}};
static struct libusb_device_handle handle[DEVICES];
static struct libusb_device *list[DEVICES + 1];
static struct libusb_endpoint_descriptor endpoint[4];
static struct libusb_interface_descriptor setting;
static struct libusb_interface interface;
static struct libusb_config_descriptor config;

static struct slot {
    struct libusb_transfer *transfer;
    bool under_way, cancelled;
} slot[TRANSFERS];

/* Mostly success. */
static int result(void)
{
    static const int codes[] = {
        LIBUSB_ERROR_IO,    LIBUSB_ERROR_INVALID_PARAM, LIBUSB_ERROR_ACCESS, LIBUSB_ERROR_NO_DEVICE,
        LIBUSB_ERROR_BUSY,  LIBUSB_ERROR_TIMEOUT,       LIBUSB_ERROR_PIPE,   LIBUSB_ERROR_NO_MEM,
        LIBUSB_ERROR_OTHER, LIBUSB_ERROR_NOT_SUPPORTED};
    uint8_t b = talk_byte();
    return b < 0xe0 ? LIBUSB_SUCCESS : codes[b % (sizeof codes / sizeof codes[0])];
}

int libusb_init(libusb_context **out)
{
    *out = &context;
    memset(slot, 0, sizeof slot);
    return LIBUSB_SUCCESS;
}
void libusb_exit(libusb_context *ctx)
{
    (void)ctx;
    for (int i = 0; i < TRANSFERS; i++) { /* those too that were never given back */
        free(slot[i].transfer);
        slot[i].transfer = NULL;
    }
}
int libusb_set_option(libusb_context *ctx, enum libusb_option option, ...)
{
    (void)ctx;
    (void)option;
    return LIBUSB_SUCCESS;
}
const char *libusb_error_name(int code)
{
    (void)code;
    return "ERROR";
}
int libusb_has_capability(uint32_t capability)
{
    (void)capability;
    return 0;
}
int libusb_hotplug_register_callback(libusb_context *ctx, int events, int flags, int vendor,
                                     int product, int class, libusb_hotplug_callback_fn callback,
                                     void *user, libusb_hotplug_callback_handle *out)
{
    (void)ctx, (void)events, (void)flags, (void)vendor, (void)product, (void)class, (void)callback,
        (void)user, (void)out;
    return LIBUSB_ERROR_NOT_SUPPORTED;
}
void libusb_hotplug_deregister_callback(libusb_context *ctx, libusb_hotplug_callback_handle which)
{
    (void)ctx, (void)which;
}

/* --- what there is -----------------------------------------------------------------------------
 */

ssize_t libusb_get_device_list(libusb_context *ctx, libusb_device ***out)
{
    (void)ctx;
    uint8_t b = talk_byte();
    ssize_t n = b == 0xff ? LIBUSB_ERROR_NO_MEM : 1 + b % DEVICES;
    for (ssize_t i = 0; i < n; i++)
        list[i] = &device[i];
    *out = list;
    return n;
}
void libusb_free_device_list(libusb_device **devices, int unref)
{
    (void)devices, (void)unref;
}
int libusb_get_device_descriptor(libusb_device *d, struct libusb_device_descriptor *out)
{
    (void)d;
    uint8_t b = talk_byte();
    *out = (struct libusb_device_descriptor){.idVendor = 0x1209,
                                             .idProduct = b & 0x80 ? 2 : 1,
                                             .iProduct = b & 1 ? 0 : 2,
                                             .iSerialNumber = b & 2 ? 0 : 3};
    return b == 0xff ? LIBUSB_ERROR_IO : LIBUSB_SUCCESS;
}
int libusb_open(libusb_device *d, libusb_device_handle **out)
{
    handle[d->number].device = d;
    *out = &handle[d->number];
    return result();
}
void libusb_close(libusb_device_handle *h)
{
    h->device = NULL;
}
libusb_device *libusb_get_device(libusb_device_handle *h)
{
    return h->device;
}
uint8_t libusb_get_bus_number(libusb_device *d)
{
    (void)d;
    return talk_byte();
}
uint8_t libusb_get_device_address(libusb_device *d)
{
    (void)d;
    return talk_byte();
}
int libusb_get_port_numbers(libusb_device *d, uint8_t *out, int size)
{
    (void)d;
    int n = talk_byte() % (size + 1);
    memset(out, talk_byte(), (size_t)n);
    return n;
}
/* Characters beyond ASCII are question marks by then; the rest is the board's. */
int libusb_get_string_descriptor_ascii(libusb_device_handle *h, uint8_t index, unsigned char *out,
                                       int size)
{
    (void)h, (void)index;
    uint8_t b = talk_byte();
    int n = b % 128;
    if (b == 0xff)
        return LIBUSB_ERROR_PIPE;
    n = n < size ? n : size - 1;
    for (int i = 0; i < n; i++)
        out[i] = talk_byte() & 0x7f;
    out[n] = '\0';
    return n;
}
int libusb_get_active_config_descriptor(libusb_device *d, struct libusb_config_descriptor **out)
{
    (void)d;
    uint8_t b = talk_byte();
    for (int i = 0; i < 4; i++)
        endpoint[i] = (struct libusb_endpoint_descriptor){
            .bEndpointAddress = i & 1 ? 0x81 : 0x01,
            .bmAttributes =
                b >> i & 1 ? LIBUSB_TRANSFER_TYPE_INTERRUPT : LIBUSB_TRANSFER_TYPE_BULK};
    setting = (struct libusb_interface_descriptor){.bNumEndpoints = (uint8_t)(b == 0x80 ? 0 : 4),
                                                   .endpoint = b == 0x80 ? NULL : endpoint};
    interface = (struct libusb_interface){&setting, b == 0x81 ? 0 : 1};
    config = (struct libusb_config_descriptor){.bNumInterfaces = (uint8_t)(b == 0x82 ? 0 : 1),
                                               .interface = &interface};
    *out = &config;
    return b == 0xff ? LIBUSB_ERROR_NOT_FOUND : LIBUSB_SUCCESS;
}
void libusb_free_config_descriptor(struct libusb_config_descriptor *c)
{
    (void)c;
}
int libusb_set_auto_detach_kernel_driver(libusb_device_handle *h, int enable)
{
    (void)h, (void)enable;
    return LIBUSB_SUCCESS;
}
int libusb_claim_interface(libusb_device_handle *h, int number)
{
    (void)h, (void)number;
    return result();
}
int libusb_release_interface(libusb_device_handle *h, int number)
{
    (void)h, (void)number;
    return LIBUSB_SUCCESS;
}
int libusb_clear_halt(libusb_device_handle *h, unsigned char which)
{
    (void)h, (void)which;
    return result();
}

/* --- transfers ---------------------------------------------------------------------------------
 */

static struct slot *slot_of(const struct libusb_transfer *t)
{
    for (int i = 0; i < TRANSFERS; i++)
        if (slot[i].transfer == t)
            return &slot[i];
    abort();
}
struct libusb_transfer *libusb_alloc_transfer(int packets)
{
    struct slot *s = slot_of(NULL);
    (void)packets;
    *s = (struct slot){.transfer = calloc(1, sizeof *s->transfer)};
    return s->transfer;
}
void libusb_free_transfer(struct libusb_transfer *t)
{
    if (!t)
        return;
    struct slot *s = slot_of(t);
    if (s->under_way)
        abort();
    free(t);
    s->transfer = NULL;
}
int libusb_submit_transfer(struct libusb_transfer *t)
{
    struct slot *s = slot_of(t);
    if (s->under_way)
        abort();
    int rc = result();
    s->under_way = rc == LIBUSB_SUCCESS;
    s->cancelled = false;
    return rc;
}
int libusb_cancel_transfer(struct libusb_transfer *t)
{
    struct slot *s = slot_of(t);
    s->cancelled = s->under_way;
    return s->under_way ? LIBUSB_SUCCESS : LIBUSB_ERROR_NOT_FOUND;
}

static void finish(struct slot *s, enum libusb_transfer_status status, int length)
{
    s->under_way = false;
    s->transfer->status = status;
    s->transfer->actual_length = length;
    s->transfer->callback(s->transfer);
}

static bool work_in(struct slot *s)
{
    static const enum libusb_transfer_status bad[] = {
        LIBUSB_TRANSFER_STALL, LIBUSB_TRANSFER_OVERFLOW, LIBUSB_TRANSFER_ERROR};
    size_t n = 0;
    enum talk_event e = talk_say(s->transfer->buffer, (size_t)s->transfer->length, &n);
    if (e == TALK_BYTES)
        finish(s, LIBUSB_TRANSFER_COMPLETED, (int)n);
    else if (e == TALK_GONE)
        finish(s, LIBUSB_TRANSFER_NO_DEVICE, 0);
    else if (e == TALK_GARBLED)
        finish(s, bad[talk_byte() % 3], 0);
    return e != TALK_SILENCE;
}

static bool work_out(struct slot *s)
{
    uint8_t b = talk_byte();
    int n = s->transfer->length;
    if (b == 0xff)
        return false; /* it does not take it */
    talk_heard(s->transfer->buffer, (size_t)n);
    finish(s,
           b == 0xfe   ? LIBUSB_TRANSFER_STALL
           : b == 0xfd ? LIBUSB_TRANSFER_NO_DEVICE
           : b == 0xfc ? LIBUSB_TRANSFER_TIMED_OUT
                       : LIBUSB_TRANSFER_COMPLETED,
           b == 0xfb ? n / 2 : n);
    return true;
}

int libusb_handle_events_timeout_completed(libusb_context *ctx, struct timeval *wait, int *done)
{
    (void)ctx, (void)done;
    bool happened = false;
    for (int i = 0; i < TRANSFERS && !happened; i++) {
        struct slot *s = &slot[i];
        if (!s->transfer || !s->under_way)
            continue;
        if (s->cancelled) {
            happened = talk_byte() != 0xff;
            if (happened)
                finish(s, LIBUSB_TRANSFER_CANCELLED, 0);
        } else {
            happened = s->transfer->endpoint & LIBUSB_ENDPOINT_IN ? work_in(s) : work_out(s);
        }
    }
    talk_pass(happened ? 1000 : wait->tv_sec * 1000000000LL + wait->tv_usec * 1000LL);
    return LIBUSB_SUCCESS;
}
