# Pendubot: swing up to the inverted position (both links up) and hold it.
setup pendubot-top
start
wait-until balanced within 4.5
expect balanced for 20
expect no-fault
halt
save pendubot-top.csv
quit
