# Error on the screen against frame time, one curve a renderer.  Draw it again: gnuplot frontier.gp > frontier.svg
set terminal svg size 1120,580 noenhanced font 'sans-serif,15' background '#ffffff' name 'frontier'
set encoding utf8
set datafile missing '?'
set border 3 lc rgb '#777777'
set tics nomirror tc rgb '#333333'
set grid lc rgb '#e6e6e6' lw 1 lt 1
set key at screen 0.5,0.9828 center top horizontal maxrows 1 Left reverse samplen 2 tc rgb '#222222'
set margins screen 0.09643, screen 0.97321, screen 0.12414, screen 0.91724
set xrange [0.183490989:10.7790985]
set yrange [2.75150632:955.031277]
set logscale x
set xtics ('0.2' 0.20000000000000001, '0.5' 0.5, '1' 1, '2' 2, '5' 5, '10' 10)
set logscale y
set ytics ('5' 5, '10' 10, '20' 20, '50' 50, '100' 100, '200' 200, '500' 500)
set xlabel 'error on the screen, p99.9 (px)' offset 0,0.3
set ylabel 'frame time, median (ms)'
set arrow from 1,graph 0 to 1,graph 1 nohead lc rgb '#999999' lw 1.2
set label 'n=63' at screen 0.77044,0.23339 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=255' at screen 0.37265,0.39623 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'n=511' at screen 0.16697,0.50923 center font 'sans-serif,12' tc rgb '#0072B2'
set label 'tau=8' at screen 0.81148,0.19826 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=4' at screen 0.62490,0.21141 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=2' at screen 0.47877,0.27214 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=1' at screen 0.33699,0.33913 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'tau=0.5' at screen 0.22811,0.47377 center font 'sans-serif,12' tc rgb '#D55E00'
set label 'rows=150' at screen 0.64491,0.28832 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=210' at screen 0.55761,0.33850 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=300' at screen 0.49431,0.40363 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=424' at screen 0.39983,0.47396 center font 'sans-serif,12' tc rgb '#009E73'
set label 'rows=600' at screen 0.29317,0.54396 center font 'sans-serif,12' tc rgb '#009E73'
set label 'step=2' at screen 0.95292,0.67348 center font 'sans-serif,12' tc rgb '#CC79A7'
plot 'frontier.dat' index 0 using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '#0072B2' notitle, \
  'frontier.dat' index 0 using 1:2 with linespoints lw 2.4 pt 7 ps 1 lc rgb '#0072B2' title 'clipmap', \
  'frontier.dat' index 1 using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '#D55E00' notitle, \
  'frontier.dat' index 1 using 1:2 with linespoints lw 2.4 pt 5 ps 1 lc rgb '#D55E00' title 'geomipmap', \
  'frontier.dat' index 2 using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '#009E73' notitle, \
  'frontier.dat' index 2 using 1:2 with linespoints lw 2.4 pt 9 ps 1 lc rgb '#009E73' title 'pgm', \
  'frontier.dat' index 3 using 1:2:3:4 with yerrorbars pt 0 ps 0 lw 1.2 lc rgb '#CC79A7' notitle, \
  'frontier.dat' index 3 using 1:2 with linespoints lw 2.4 pt 13 ps 1 lc rgb '#CC79A7' title 'decimated', \
  637.9907 with lines dt 2 lw 1.5 lc rgb '#333333' title 'brute: 638 ms'
