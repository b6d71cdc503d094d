# The identification input of the report, (3.28): 1.5 sin 6t on the pendubot.
model ../models/pendubot.ini
setup open-loop
input 1.5*sin(6*t)
start
wait 10
expect no-fault
halt
save open-loop.csv
quit
