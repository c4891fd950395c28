#!/usr/bin/env bash
# A Rust compiler with the standard library of 64-bit ARM, from Debian's packages, for where
# `rustup target add aarch64-unknown-linux-gnu` cannot be had: `bash xtask/aarch64/toolchain.sh DIR` makes DIR, in which
# `rustc` is the compiler (GNP_AARCH64_RUSTC), and does nothing where it is there. Nothing is installed: the packages are
# unpacked in DIR. Debian keeps a recent compiler, for its browsers, under the name rustc-web; it must be no older than the
# project's. 130 MB to fetch, 600 MB on the disk, half a minute.
set -euo pipefail
place=$(realpath -m "$1")
if "$place/rustc" --version >/dev/null 2>&1; then exit 0; fi
new="$place.$$"
trap 'rm -rf "$new"' EXIT
mkdir -p "$new"/{lists,archives}/partial "$new/system"
options=(
    -qq -o Debug::NoLocking=1 -o APT::Sandbox::User=root -o Acquire::Languages=none
    -o APT::Architecture=amd64 -o APT::Architectures::=amd64 -o APT::Architectures::=arm64
    -o "Dir::State::lists=$new/lists" -o "Dir::Cache=$new" -o "Dir::Cache::archives=$new/archives"
)
apt-get "${options[@]}" update
# With the libraries that it needs and this machine lacks.
apt-get "${options[@]}" -y --no-install-recommends --reinstall --download-only install rustc-web
version=$(dpkg-deb --field "$new"/archives/rustc-web_*.deb Version)
(cd "$new/archives" && apt-get "${options[@]}" download "libstd-rust-web-dev:arm64=$version")
for package in "$new"/archives/*.deb; do
    dpkg-deb --extract "$package" "$new/system"
done
cat >"$new/rustc" <<EOF
#!/bin/sh
LD_LIBRARY_PATH="$place/system/usr/lib/x86_64-linux-gnu" exec "$place/system/usr/bin/rustc" "\$@"
EOF
chmod +x "$new/rustc"
rm -rf "$new/lists" "$new/archives" "$place"
mv "$new" "$place"
"$place/rustc" --version
