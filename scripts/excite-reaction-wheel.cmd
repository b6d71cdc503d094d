# Reaction wheel: an input for identification found by mechkit excite, command within 1.5. The largest standard
# error that a fit of these 10 s can reach is 0.005 %; of 1.5 sin 6t: 0.030 %.
model ../models/reaction-wheel.ini
setup open-loop
input 1.5*tanh(0.9642*sin(1.75049*t)-0.0854*cos(1.75049*t)-0.374*sin(3.50098*t)-0.5215*cos(3.50098*t)+0.7018*sin(5.25147*t)-0.2129*cos(5.25147*t)-0.9143*sin(7.00196*t)+0.8364*cos(7.00196*t)-4.8741*sin(8.75245*t)+1.9238*cos(8.75245*t)+0.5934*sin(10.50294*t)+0.0198*cos(10.50294*t)-0.7597*sin(12.25343*t)-0.4228*cos(12.25343*t)+1.2592*sin(14.00392*t)-0.4704*cos(14.00392*t))
start
wait 10
expect no-fault
halt
save excite-reaction-wheel.csv
quit
