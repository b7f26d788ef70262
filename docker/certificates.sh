#!/bin/sh
# Makes certificates for a trial with openssl 3: an authority, one for a server and some for clients.
#
#     docker/certificates.sh DIR HOST[,HOST...] CLIENT...
#
# HOST: a name or address under which clients reach the server; '' for certificates of clients only.
# CLIENT: the name that access rules know it by. A DIR that has an authority gets further
# certificates from it; a certificate that exists is never overwritten.
set -eu
dir=$1 hosts=$2
shift 2
mkdir -p "$dir"
cd "$dir"

new() { # NAME SUBJECT OPTION...: openssl makes the key readable for its owner only
    name=$1 subject=$2
    shift 2
    [ ! -e "$name.pem" ] || { echo "$dir/$name.pem exists: choose another name" >&2 && exit 1; }
    openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -noenc -days 365 \
        -subj "/CN=$subject" -keyout "$name-key.pem" -out "$name.pem" "$@"
}

sign() { # NAME OPTION...
    name=$1
    shift
    new "$name" "$name" -CA ca.pem -CAkey ca-key.pem -addext basicConstraints=critical,CA:FALSE "$@"
}

# Authorities of different folders have different names, so that no client confuses them.
[ -e ca.pem ] || new ca "trial authority $(openssl rand -hex 4)"
names=
for host in $(echo "$hosts" | tr , ' '); do
    case $host in
    *:* | [0-9]*.[0-9]*.[0-9]*.[0-9]*) names="$names,IP:$host" ;;
    *) names="$names,DNS:$host" ;;
    esac
done
[ -z "$names" ] || sign server -addext "subjectAltName=${names#,}"
for client; do
    sign "$client"
done
