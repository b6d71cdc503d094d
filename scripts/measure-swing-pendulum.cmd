# Pendulum: pumped up for two seconds, then let go. mechkit measure swing reads the natural
# frequency off the free swings.
model ../models/pendulum.ini
setup open-loop
input 5*sin(10*t)*pulse(0, 2.2)
start
wait 6
expect no-fault
halt
save measure-swing-pendulum.csv
quit
