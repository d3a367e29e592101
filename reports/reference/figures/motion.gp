# How far drawn ground moves from frame to frame, one line a renderer.  Draw it again: gnuplot motion.gp > motion.svg
set terminal svg size 1120,400 noenhanced font 'sans-serif,15' background '#ffffff' name 'motion'
set encoding utf8
set datafile missing '?'
set border 3 lc rgb '#777777'
set tics nomirror tc rgb '#333333'
set grid lc rgb '#e6e6e6' lw 1 lt 1
set key at screen 0.5,0.9750 center top horizontal maxrows 1 Left reverse samplen 2 tc rgb '#222222'
set margins screen 0.09643, screen 0.97321, screen 0.18000, screen 0.88000
set xrange [1:31]
set yrange [0.36956281:7.7061351]
set logscale y
set ytics ('0.5' 0.5, '0.7' 0.70000000000000007, '1' 1, '2' 2, '3' 3, '5' 5, '7' 7)
set format x '%g'
set xlabel 'frame of the path' offset 0,0.3
set ylabel 'moved, p99.9 (px)'
set arrow from graph 0,first 1 to graph 1,first 1 nohead lc rgb '#999999' lw 1.2
plot 'motion.dat' index 0 using 1:2 with linespoints lw 2 pt 7 ps 0.45 lc rgb '#0072B2' title 'clipmap n=127', \
  'motion.dat' index 1 using 1:2 with linespoints lw 2 pt 5 ps 0.45 lc rgb '#D55E00' title 'geomipmap tau=2', \
  'motion.dat' index 2 using 1:2 with linespoints lw 2 pt 9 ps 0.45 lc rgb '#009E73' title 'pgm rows=300'
