# Pendubot: an input for identification found by mechkit excite, command within 1.5. The largest standard
# error that a fit of these 10 s can reach is 0.009 %; of 1.5 sin 6t: 0.031 %.
model ../models/pendubot.ini
setup open-loop
input 1.5*tanh(-2.4012*sin(1.91801*t)-0.5046*cos(1.91801*t)+0.7711*sin(3.83602*t)+1.9824*cos(3.83602*t)-0.8552*sin(5.75403*t)+1.6913*cos(5.75403*t)+0.4607*sin(7.67204*t)+1.5892*cos(7.67204*t)+0.9117*sin(9.59005*t)+0.8064*cos(9.59005*t)-0.8923*sin(11.50806*t)+1.379*cos(11.50806*t)-0.2697*sin(13.42607*t)-1.3533*cos(13.42607*t)-0.0844*sin(15.34408*t)-1.491*cos(15.34408*t))
start
wait 10
expect no-fault
halt
save excite-pendubot.csv
quit
