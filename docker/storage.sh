#!/bin/sh
# The object store with one user, `tieline`, who owns one bucket and can do nothing else. The root account gets a
# password anew at each start, which nobody is told.
set -eu
umask 077

ROOT_ACCESS_KEY=root
ROOT_SECRET_KEY=$(od -An -N32 -tx1 /dev/urandom | tr -d ' \n')
here="http://127.0.0.1:7070"
mkdir -p "$VGW_IAM_DIR"

ROOT_ACCESS_KEY=$ROOT_ACCESS_KEY ROOT_SECRET_KEY=$ROOT_SECRET_KEY docker-entrypoint.sh &
server=$!
trap 'kill -TERM "$server"' TERM INT

until wget -q -O /dev/null "$here/health"; do
  kill -0 "$server"
  sleep 1
done
as_root() {
  ADMIN_ACCESS_KEY_ID=$ROOT_ACCESS_KEY ADMIN_SECRET_ACCESS_KEY=$ROOT_SECRET_KEY ADMIN_ENDPOINT_URL=$here \
    versitygw admin "$@"
}
# accounts are kept in memory (VGW_IAM_DIR), so there is none yet
as_root create-user --access tieline --secret "$STORAGE_PASSWORD" --role user
as_root change-bucket-owner --bucket tieline --owner tieline
touch /tmp/ready

# a signal ends the first wait; the second one is for the server
wait "$server" || wait "$server"
