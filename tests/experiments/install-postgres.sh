#!/bin/sh
# PostgreSQL's server from the distribution, for tests/experiments/test_storage.py. Does nothing where there is one,
# or where only root could install it.
set -eu
if command -v initdb >/dev/null 2>&1 || ls /usr/lib/postgresql/*/bin/initdb >/dev/null 2>&1; then
    exit 0
fi
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null 2>&1; then
    echo "no PostgreSQL server: the tests that need one are skipped (install the package postgresql)" >&2
    exit 0
fi
export DEBIAN_FRONTEND=noninteractive
# the tests make a cluster of their own, in a temporary folder: no other is wanted, and none that runs
mkdir -p /etc/postgresql-common
[ -e /etc/postgresql-common/createcluster.conf ] || echo 'create_main_cluster = false' >/etc/postgresql-common/createcluster.conf
apt-get update -qq
UCF_FORCE_CONFFOLD=1 apt-get install -y -qq --no-install-recommends postgresql >/dev/null
