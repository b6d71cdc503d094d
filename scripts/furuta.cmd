# Furuta pendulum: swing up by energy and hold it.
setup furuta
start
wait-until balanced within 4.5
expect balanced for 20
expect no-fault
halt
save furuta.csv
quit
