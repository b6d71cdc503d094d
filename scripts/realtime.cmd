# The pendubot in real time: six seconds, with gains exchanged while it balances.
setup pendubot-mid
start
wait-until balanced within 4.5
set kp 150
expect balanced for 2
halt
save realtime.csv
quit
