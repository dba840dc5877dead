#!/bin/sh
# Serve the studio of the current folder, and forward port 8421 of the container to it.
socat TCP-LISTEN:8421,fork,reuseaddr TCP:127.0.0.1:8420 &
exec rvsg studio --port 8420 --no-browser "$@"
