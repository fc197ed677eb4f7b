#!/bin/sh
# Steps that all images share.
#
# usage: install.sh PACKAGE...        from Debian, and nothing left behind but them
#        install.sh --check PROGRAM   fail where a shared library is missing
#        install.sh --folders DIR...  that the user of the image may write to; new volumes get their
#                                     owner from them
set -eu

case $1 in
  --check)
    missing=$(ldd "$2" | grep 'not found' || true)
    [ -z "$missing" ] || {
      echo "install.sh: $2 needs more packages, or was not compiled on a Debian 12: $missing" >&2
      exit 1
    }
    ;;
  --folders)
    shift
    install -d -m 0750 -o 10001 -g 10001 "$@"
    ;;
  *)
    # Servers that a package would start have no place in an image.
    printf '#!/bin/sh\nexit 101\n' >/usr/sbin/policy-rc.d
    chmod 755 /usr/sbin/policy-rc.d
    apt-get update -qq
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "$@" >/dev/null
    rm -rf /var/lib/apt/lists/* /var/cache/apt/* /var/log/apt /var/log/dpkg.log /usr/sbin/policy-rc.d
    ;;
esac
