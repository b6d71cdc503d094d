#include "emu/udev.h"

#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>

#define DEVICES 4
#define MONITORS 4
#define EVENTS 64
#define EXPORT __attribute__((visibility("default")))

struct udev_device {
    char name[16];
    char node[64];
    char path[64];
    const char *action;
};
struct udev_list_entry {
    char path[64];
    struct udev_list_entry *next;
};
struct udev_enumerate {
    struct udev_list_entry entry[DEVICES];
    int count;
};
struct udev_monitor {
    int fd;
    unsigned seen; /* events taken */
};
struct udev;

static pthread_mutex_t lock = PTHREAD_MUTEX_INITIALIZER;
static struct udev_device devices[DEVICES]; /* name "": free */
static struct udev_monitor *monitors[MONITORS];
static struct udev_device events[EVENTS]; /* ring */
static unsigned event_count;

/* --- plugging ------------------------------------------------------------------------------------
 */

static void fill(struct udev_device *d, const char *name, const char *node, const char *action)
{
    snprintf(d->name, sizeof d->name, "%s", name);
    snprintf(d->node, sizeof d->node, "%s", node);
    snprintf(d->path, sizeof d->path, "/sys/devices/emu/%s", name);
    d->action = action;
}

static void announce(const struct udev_device *d, const char *action)
{
    fill(&events[event_count++ % EVENTS], d->name, d->node, action);
    for (int i = 0; i < MONITORS; i++)
        if (monitors[i] && eventfd_write(monitors[i]->fd, 1) != 0)
            abort();
}

static struct udev_device *find(const char *name)
{
    for (int i = 0; i < DEVICES; i++)
        if (strcmp(devices[i].name, name) == 0)
            return &devices[i];
    return NULL;
}

void emu_udev_plug(const char *name, const char *node)
{
    pthread_mutex_lock(&lock);
    struct udev_device *d = find("");
    if (d) {
        fill(d, name, node, NULL);
        announce(d, "add");
    }
    pthread_mutex_unlock(&lock);
}

void emu_udev_unplug(const char *name)
{
    pthread_mutex_lock(&lock);
    struct udev_device *d = find(name);
    if (d) {
        announce(d, "remove");
        d->name[0] = '\0';
    }
    pthread_mutex_unlock(&lock);
}

/* --- libudev's names -----------------------------------------------------------------------------
 */

struct udev *udev_new(void);
EXPORT struct udev *udev_new(void)
{
    static char something;
    return (struct udev *)(void *)&something;
}
struct udev *udev_unref(struct udev *udev);
EXPORT struct udev *udev_unref(struct udev *udev)
{
    (void)udev;
    return NULL;
}

struct udev_enumerate *udev_enumerate_new(struct udev *udev);
EXPORT struct udev_enumerate *udev_enumerate_new(struct udev *udev)
{
    (void)udev;
    return calloc(1, sizeof(struct udev_enumerate));
}
int udev_enumerate_add_match_subsystem(struct udev_enumerate *e, const char *subsystem);
EXPORT int udev_enumerate_add_match_subsystem(struct udev_enumerate *e, const char *subsystem)
{
    (void)e;
    (void)subsystem;
    return 0;
}
int udev_enumerate_add_match_property(struct udev_enumerate *e, const char *name,
                                      const char *value);
EXPORT int udev_enumerate_add_match_property(struct udev_enumerate *e, const char *name,
                                             const char *value)
{
    (void)e;
    (void)name;
    (void)value;
    return 0;
}
int udev_enumerate_scan_devices(struct udev_enumerate *e);
EXPORT int udev_enumerate_scan_devices(struct udev_enumerate *e)
{
    pthread_mutex_lock(&lock);
    e->count = 0;
    for (int i = 0; i < DEVICES; i++)
        if (devices[i].name[0])
            memcpy(e->entry[e->count++].path, devices[i].path, sizeof devices[i].path);
    pthread_mutex_unlock(&lock);
    for (int i = 0; i < e->count; i++)
        e->entry[i].next = i + 1 < e->count ? &e->entry[i + 1] : NULL;
    return 0;
}
struct udev_list_entry *udev_enumerate_get_list_entry(struct udev_enumerate *e);
EXPORT struct udev_list_entry *udev_enumerate_get_list_entry(struct udev_enumerate *e)
{
    return e->count > 0 ? e->entry : NULL;
}
struct udev_enumerate *udev_enumerate_unref(struct udev_enumerate *e);
EXPORT struct udev_enumerate *udev_enumerate_unref(struct udev_enumerate *e)
{
    free(e);
    return NULL;
}
struct udev_list_entry *udev_list_entry_get_next(struct udev_list_entry *entry);
EXPORT struct udev_list_entry *udev_list_entry_get_next(struct udev_list_entry *entry)
{
    return entry->next;
}
const char *udev_list_entry_get_name(struct udev_list_entry *entry);
EXPORT const char *udev_list_entry_get_name(struct udev_list_entry *entry)
{
    return entry->path;
}

static struct udev_device *copy(const struct udev_device *from)
{
    struct udev_device *d = malloc(sizeof *d);
    if (d)
        *d = *from;
    return d;
}

struct udev_device *udev_device_new_from_syspath(struct udev *udev, const char *path);
EXPORT struct udev_device *udev_device_new_from_syspath(struct udev *udev, const char *path)
{
    struct udev_device *d = NULL;
    (void)udev;
    pthread_mutex_lock(&lock);
    for (int i = 0; i < DEVICES && !d; i++)
        if (devices[i].name[0] && strcmp(devices[i].path, path) == 0)
            d = copy(&devices[i]);
    pthread_mutex_unlock(&lock);
    return d;
}
struct udev_device *udev_device_unref(struct udev_device *d);
EXPORT struct udev_device *udev_device_unref(struct udev_device *d)
{
    free(d);
    return NULL;
}
const char *udev_device_get_devnode(struct udev_device *d);
EXPORT const char *udev_device_get_devnode(struct udev_device *d)
{
    return d->node;
}
const char *udev_device_get_sysname(struct udev_device *d);
EXPORT const char *udev_device_get_sysname(struct udev_device *d)
{
    return d->name;
}
const char *udev_device_get_action(struct udev_device *d);
EXPORT const char *udev_device_get_action(struct udev_device *d)
{
    return d->action;
}

struct udev_monitor *udev_monitor_new_from_netlink(struct udev *udev, const char *name);
EXPORT struct udev_monitor *udev_monitor_new_from_netlink(struct udev *udev, const char *name)
{
    struct udev_monitor *m = calloc(1, sizeof *m);
    (void)udev;
    (void)name;
    if (!m)
        return NULL;
    m->fd = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK | EFD_SEMAPHORE);
    pthread_mutex_lock(&lock);
    m->seen = event_count;
    for (int i = 0; i < MONITORS; i++)
        if (!monitors[i]) {
            monitors[i] = m;
            break;
        }
    pthread_mutex_unlock(&lock);
    return m;
}
int udev_monitor_filter_add_match_subsystem_devtype(struct udev_monitor *m, const char *subsystem,
                                                    const char *type);
EXPORT int udev_monitor_filter_add_match_subsystem_devtype(struct udev_monitor *m,
                                                           const char *subsystem, const char *type)
{
    (void)m;
    (void)subsystem;
    (void)type;
    return 0;
}
int udev_monitor_enable_receiving(struct udev_monitor *m);
EXPORT int udev_monitor_enable_receiving(struct udev_monitor *m)
{
    (void)m;
    return 0;
}
int udev_monitor_get_fd(struct udev_monitor *m);
EXPORT int udev_monitor_get_fd(struct udev_monitor *m)
{
    return m->fd;
}
struct udev_device *udev_monitor_receive_device(struct udev_monitor *m);
EXPORT struct udev_device *udev_monitor_receive_device(struct udev_monitor *m)
{
    eventfd_t one;
    struct udev_device *d = NULL;
    if (eventfd_read(m->fd, &one) != 0)
        return NULL;
    pthread_mutex_lock(&lock);
    if (m->seen != event_count)
        d = copy(&events[m->seen++ % EVENTS]);
    pthread_mutex_unlock(&lock);
    return d;
}
struct udev_monitor *udev_monitor_unref(struct udev_monitor *m);
EXPORT struct udev_monitor *udev_monitor_unref(struct udev_monitor *m)
{
    pthread_mutex_lock(&lock);
    for (int i = 0; i < MONITORS; i++)
        if (monitors[i] == m)
            monitors[i] = NULL;
    pthread_mutex_unlock(&lock);
    close(m->fd);
    free(m);
    return NULL;
}
