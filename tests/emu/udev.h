/* The part of libudev that libusb uses, over a list of devices kept here: these functions stand
 * before the library's. */
#ifndef MECHKIT_TESTS_EMU_UDEV_H
#define MECHKIT_TESTS_EMU_UDEV_H

/* Both may be called from any thread; whoever monitors is told. `name` as in sysfs ("1-1"). */
void emu_udev_plug(const char *name, const char *node);
void emu_udev_unplug(const char *name);

#endif
