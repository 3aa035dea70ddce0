#!/bin/sh
# The distribution's programs that tests really run: PostgreSQL's server for the study, a browser for the report,
# compilers and interpreters for the exports. What is there already is left alone; where only root could install
# something, it is said, and the tests that need it are skipped.
set -eu

missing=""
want() { # want PACKAGE COMMAND: the package, unless the command is there
    command -v "$2" >/dev/null 2>&1 || missing="$missing $1"
}
command -v initdb >/dev/null 2>&1 || ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1 || missing=" postgresql"
want chromium chromium
want gcc cc
want rustc rustc
want nodejs node
want graphviz dot
want gcc-arm-none-eabi arm-none-eabi-gcc
want gcc-avr avr-gcc
want avr-libc avr-gcc

# Mermaid itself, which draws what is exported for it: from the npm registry, and without it one test is skipped
node_modules="$HOME/.cache/sympol-tests"
if [ ! -d "$node_modules/node_modules/mermaid" ] && command -v npm >/dev/null 2>&1; then
    npm install --silent --ignore-scripts --prefix "$node_modules" mermaid@12 >/dev/null 2>&1 ||
        echo "not installed, so the test that needs it is skipped: mermaid" >&2
fi
[ -z "$missing" ] && exit 0

if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "not installed, so the tests that need them are skipped:$missing" >&2
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
# the tests make a cluster of their own, in a temporary folder: no other is wanted, and none that runs
mkdir -p /etc/postgresql-common
[ -e /etc/postgresql-common/createcluster.conf ] || echo 'create_main_cluster = false' >/etc/postgresql-common/createcluster.conf
apt-get update -qq
# shellcheck disable=SC2086  # a list of packages
UCF_FORCE_CONFFOLD=1 apt-get install -y -qq --no-install-recommends $missing >/dev/null
