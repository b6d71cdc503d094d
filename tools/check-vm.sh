#!/bin/sh
# The boards' tests on a real kernel: a small virtual machine in which libusb talks to the kernel's
# usbfs (the boards sit behind vhci_hcd) and ppdev's own answers are looked at. Skips, saying why,
# where something is missing.
# Usage: tools/check-vm.sh TESTS DIRECTORY [SUITE...]
#
# MECHKIT_VM_KERNEL names a folder with boot/vmlinuz-* and lib/modules, as a kernel package unpacks to;
# without it the machine's own kernel is taken if its modules are there, else Debian's package is
# fetched into DIRECTORY (once, 70 MB, nothing is installed).
set -eu
tests=$1
dir=$2
shift 2
suites=${*:-board usb bus_runs bus_faults ppdev}
seconds=${MECHKIT_VM_SECONDS:-2700}

skip() {
    echo "check-vm: skipped: $1"
    exit 0
}

has_modules() { # FOLDER
    ls "$1"/boot/vmlinuz-* >/dev/null 2>&1 &&
        find "$1/lib/modules" -name 'vhci-hcd.ko*' 2>/dev/null | grep -q .
}

[ "$(uname -m)" = x86_64 ] || skip "only x86-64 machines are emulated here"
for tool in qemu-system-x86_64:qemu-system-x86 busybox:busybox-static cpio:cpio; do
    command -v "${tool%:*}" >/dev/null 2>&1 || skip "no ${tool%:*} (apt-get install ${tool#*:})"
done
! ldd "$(command -v busybox)" >/dev/null 2>&1 || skip "busybox is not static (apt-get install busybox-static)"

mkdir -p "$dir"
kernel=${MECHKIT_VM_KERNEL:-}
if [ -z "$kernel" ]; then
    kernel=$dir/kernel
    if has_modules /; then
        kernel=/
    elif ! has_modules "$kernel"; then
        package=$(apt-cache depends linux-image-amd64 2>/dev/null |
            sed -n 's/.*Depends: \(linux-image-[^ ]*\)/\1/p' | head -n 1)
        [ -n "$package" ] || skip "no kernel with the module vhci-hcd, and no Debian package of one"
        echo "check-vm: fetching $package into $dir ..."
        (cd "$dir" && apt-get -qq download "$package" 2>/dev/null) || skip "$package cannot be fetched"
        dpkg-deb -x "$dir/$package"_*.deb "$kernel"
        rm -f "$dir/$package"_*.deb
    fi
fi
has_modules "$kernel" || skip "no kernel with the module vhci-hcd under $kernel"
image=$(ls "$kernel"/boot/vmlinuz-* | tail -n 1)
modules=$kernel/lib/modules/${image##*/vmlinuz-}

# --- what the machine boots: busybox, the modules, the tests and their libraries ---
root=$dir/root
rm -rf "$root"
mkdir -p "$root/bin" "$root/modules" "$root/proc" "$root/sys" "$root/dev" "$root/tmp"
cp "$(command -v busybox)" "$root/bin/busybox"
for name in usb-common usbcore usbip-core vhci-hcd usbserial parport parport_pc ppdev; do
    file=$(find "$modules" -name "$name.ko*" | head -n 1)
    [ -n "$file" ] || skip "the kernel has no module $name"
    case $file in
    *.xz) xz -dc "$file" >"$root/modules/$name.ko" ;;
    *.zst) zstd -qdc "$file" >"$root/modules/$name.ko" ;;
    *) cp "$file" "$root/modules/$name.ko" ;;
    esac
done
strip -o "$root/bin/tests" "$tests"
ldd "$tests" | sed -n 's/.*[ \t]\(\/[^ ]*\) (0x.*/\1/p' | while read -r library; do
    mkdir -p "$root${library%/*}"
    cp -L "$library" "$root$library"
done
cat >"$root/init" <<EOF
#!/bin/busybox sh
export PATH=/bin
/bin/busybox --install -s /bin
mount -t proc none /proc
mount -t sysfs none /sys
mount -t devtmpfs none /dev
mkdir -p /dev/pts
mount -t devpts none /dev/pts
ifconfig lo 127.0.0.1 up
for m in usb-common usbcore usbip-core vhci-hcd parport parport_pc ppdev; do
    insmod /modules/\$m.ko || echo "no module \$m"
done
echo
echo "check-vm: \$(uname -sr)"
MECHKIT_PORT=/dev/parport0 ${MECHKIT_VM_ENVIRONMENT:-} CK_TIMEOUT_MULTIPLIER=20 tests $suites
echo "check-vm: exit \$?"
poweroff -f
EOF
chmod +x "$root/init"
(cd "$root" && find . | cpio -o -H newc --quiet | gzip -1) >"$dir/initramfs.gz"

# The machine's time is counted in its own instructions (a thousand million a second), so that deadlines do
# not depend on how busy the host is; idle time is skipped.
echo "check-vm: $(basename "$image"), suites: $suites"
timeout "$seconds" qemu-system-x86_64 -accel tcg -cpu max -icount shift=0,sleep=off -m 1024 -nographic -no-reboot \
    -parallel null -kernel "$image" -initrd "$dir/initramfs.gz" \
    -append "console=ttyS0 quiet panic=-1 tsc=reliable" >"$dir/console.log" 2>&1 </dev/null || true
tr -d '\r' <"$dir/console.log" | sed -n '/^check-vm: Linux/,/^check-vm: exit/p'
tr -d '\r' <"$dir/console.log" | grep -q '^check-vm: exit 0$' ||
    { echo "check-vm: failed; the machine's output is in $dir/console.log"; exit 1; }
