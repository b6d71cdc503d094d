# Cart-pole: swing the pole up by energy and hold it, the carriage in the middle of its track.
setup cart-pole
start
wait-until balanced within 6
expect balanced for 20
expect no-fault
halt
save cart-pole.csv
quit
