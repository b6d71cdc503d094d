#!/bin/sh
# README's two commands on a bare Debian, as root or as a plain user with sudo: in a root folder of the
# packages that every Debian has, git and make added, with the 64 MB of /dev/shm that containers have. What
# is committed is taken. Skips, saying why, where this machine does not allow it.
# Usage: tools/check-bare.sh DIRECTORY [RELEASE [root|USER]]      (make check-bare RELEASE=trixie)
set -eu
dir=$1
release=${2:-stable}
user=${3:-root}
source=$(cd "$(dirname "$0")/.." && pwd)

skip() {
    echo "check-bare: skipped: $1"
    exit 0
}

[ "$(id -u)" = 0 ] || skip "only root can change the root folder (sudo make check-bare)"
command -v debootstrap >/dev/null 2>&1 || skip "no debootstrap (apt-get install debootstrap)"
unshare -m -p -f true 2>/dev/null || skip "no mount namespaces here"

mkdir -p "$dir"
root=$(cd "$dir" && pwd)/$release
if [ ! -e "$root/etc/debian_version" ]; then
    rm -rf "$root"
    debootstrap --variant=minbase "$release" "$root" >"$dir/debootstrap.log" 2>&1 ||
        skip "debootstrap cannot make $release ($dir/debootstrap.log)"
fi
rm -rf "$root/mechkit.git"
git clone -q --bare "$source" "$root/mechkit.git"
cp /etc/resolv.conf "$root/etc/resolv.conf"
echo "127.0.0.1 localhost" >"$root/etc/hosts"

cat >"$root/root/prepare" <<'END'
export DEBIAN_FRONTEND=noninteractive
apt-get update -qq && apt-get install -y -qq --no-install-recommends git make ca-certificates
if [ "$1" != root ]; then
    apt-get install -y -qq sudo
    id "$1" || useradd -m -s /bin/bash "$1"
    echo "$1 ALL=(ALL) NOPASSWD: ALL" >/etc/sudoers.d/mechkit
fi
END
cat >"$root/usr/local/bin/two-commands" <<'END'
set -e
cd ~ && rm -rf mechkit
git config --global --replace-all safe.directory /mechkit.git
git clone -q /mechkit.git mechkit && cd mechkit
for target in demo check; do
    began=$(date +%s)
    make $target >../$target.log 2>&1 && code=0 || code=$?
    echo "check-bare: make $target: exit $code after $(($(date +%s) - began)) s"
    [ $code = 0 ] || { tail -n 40 ../$target.log; exit $code; }
done
END
# Devices of its own: none of this machine's boards is there, and /dev/shm is small.
cat >"$root/root/enter" <<'END'
set -e
cd "$(dirname "$0")/.."
mount --make-rprivate /
mount -t proc proc proc
mount -t tmpfs tmpfs dev
for name in null zero full random urandom tty; do
    : >dev/$name
    mount --bind /dev/$name dev/$name
done
mkdir dev/shm dev/pts
mount -t tmpfs -o size=64m,mode=1777 tmpfs dev/shm
mount -t devpts -o newinstance,ptmxmode=0666 devpts dev/pts
ln -s pts/ptmx dev/ptmx
ln -s /proc/self/fd dev/fd
for n in 0:stdin 1:stdout 2:stderr; do ln -s /proc/self/fd/${n%:*} dev/${n#*:}; done
chroot . sh /root/prepare "$1" >root/prepare.log 2>&1 || { tail root/prepare.log; exit 1; }
exec chroot . su - "$1" -c "sh /usr/local/bin/two-commands"
END
echo "check-bare: Debian $(cat "$root/etc/debian_version"), as $user"
exec unshare -m -p -f --kill-child sh "$root/root/enter" "$user"
