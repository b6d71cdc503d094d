# Swing up and hold the pendubot through whatever board is plugged in, in real time.
setup pendubot-mid
start
wait-until balanced within 10
wait 2
expect balanced for 1
halt
save usb.csv
quit
