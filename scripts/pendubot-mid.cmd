# Pendubot: swing up to the semi-inverted position (link 1 down, link 2 up) and hold it.
setup pendubot-mid
start
wait-until balanced within 4.5
expect balanced for 20
expect no-fault
halt
save pendubot-mid.csv
quit
