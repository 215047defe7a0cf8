autocmd BufRead,BufNewFile *.ron setfiletype ron
