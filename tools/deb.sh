#!/bin/sh
# Builds the Debian packages in BUILD/deb from a copy of the sources, and lets lintian look at them:
# tools/deb.sh BUILD. Fetches nothing; what is missing for the build is named. Tests are left to
# `make check` (DEB_BUILD_OPTIONS= runs them).
set -eu
cd "$(dirname "$0")/.."
command -v dpkg-buildpackage >/dev/null 2>&1 || {
    echo "deb: dpkg-buildpackage is missing: apt-get install dpkg-dev debhelper" >&2
    exit 1
}
version=$(sed -n '1s/.*(\(.*\)).*/\1/p' debian/changelog)
if [ "$version" != "$(cat VERSION)" ]; then
    echo "deb: debian/changelog is of $version, VERSION says $(cat VERSION)" >&2
    exit 1
fi
out=$1/deb
tree=$out/mechkit-$version
rm -rf "$out"
mkdir -p "$tree"
tar -c --exclude-vcs --exclude="./${1#./}" --exclude=./build . | tar -x -C "$tree"

export DEB_BUILD_OPTIONS="${DEB_BUILD_OPTIONS-nocheck parallel=$(nproc)}"
profiles=""
case " $DEB_BUILD_OPTIONS " in *" nocheck "*) profiles=-Pnocheck ;; esac
(cd "$tree" && dpkg-buildpackage --build=binary -us -uc $profiles) >"$out/build.log" 2>&1 || {
    tail -n 20 "$out/build.log" >&2
    echo "deb: the build failed; all of it is in $out/build.log" >&2
    exit 1
}
rm -rf "$tree"
if command -v lintian >/dev/null 2>&1; then
    lintian --fail-on error --suppress-tags bad-distribution-in-changes-file "$out"/*.changes
else
    echo "deb: lintian is not installed: the packages were not looked at" >&2
fi
ls -l "$out"/*.deb
