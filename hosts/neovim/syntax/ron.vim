" Highlighting of RON and of the keywords of graphs. If several rules match at a position, the last one applies.
if exists("b:current_syntax")
  finish
endif

syntax case match
" Without the hyphen, which only editor commands treat as part of a word.
syntax iskeyword @,48-57,_
syntax sync fromstart

syntax match ronVariable /\<\l[[:lower:][:digit:]]*\%(-[[:lower:][:digit:]]\+\)*/ contained
syntax match ronChoice /\<\%(r#\)\?\a[[:alnum:]_]*\>/
syntax match ronNumber /\%([[:alnum:]_]\)\@<![-+]\?\%(0x[[:xdigit:]_]\+\|0b[01_]\+\|0o[0-7_]\+\|\d[0-9_]*\%(\.[0-9_]*\)\?\%([eE][-+]\?[0-9_]\+\)\?\|\.\d[0-9_]*\%([eE][-+]\?[0-9_]\+\)\?\)\%(_\?[iu]\%(8\|16\|32\|64\|128\)\|_\?f\%(32\|64\)\)\?/
syntax match ronConstant /\<\%(true\|false\|None\)\>\|[-+]\?\<\%(inf\|NaN\)\%(f32\|f64\)\?\>/
syntax match ronType /\<\u[[:alnum:]_]*\ze\_s*(/
syntax match ronFile /\<\%(Graph\|Patch\|Test\|Sweep\)\ze\_s*(/
syntax match ronKeyword /\<\%(Param\|Expr\|Draft\|ForEach\|Switch\|Optional\|Parts\|Holes\)\ze\_s*(/
syntax match ronUnit /\<\%(mm\|cm\|m\|inch\|deg\|rad\|px\)\ze\s*(/
syntax match ronField /\<\%(r#\)\?[a-z_][[:alnum:]_]*\ze\_s*:/
syntax match ronAttribute /#!\[\_[^\]]*\]/

syntax match ronEscape /\\\%(u{\x\{1,6}}\|x\x\x\|.\)/ contained
syntax region ronText start=/\<b\?"/ start=/"/ skip=/\\./ end=/"/ contains=ronEscape,@Spell
syntax match ronLetter /\<\?b\?'\%([^'\\]\|\\\%(u{\x\+}\|x\x\x\|.\)\)'/
" Comments are allowed between a key and its colon.
syntax match ronKey /"[^"\\]*"\ze\s*\%(\/\*.\{-}\*\/\s*\)*:/
syntax match ronColor /"#\%(\x\{8}\|\x\{6}\|\x\{3,4}\)"/
syntax region ronRaw start=/\<b\?r\z(#*\)"/ end=/"\z1/

syntax region ronExpression matchgroup=ronKeyword start=/\<Expr\ze\_s*(/ matchgroup=NONE end=/)/ contains=ronFormula,ronRawFormula,ronComment,ronBlock
syntax region ronFormula matchgroup=ronText start=/"/ skip=/\\./ end=/"/ contained contains=@ronInFormula
syntax region ronRawFormula matchgroup=ronRaw start=/\<r\z(#*\)"/ end=/"\z1/ contained contains=@ronInFormula
syntax match ronFunction /\<\%(if\|min\|max\|clamp\|abs\|floor\|round\|sqrt\|pow\|sin\|cos\|tan\|asin\|acos\|atan\|atan2\)\ze\s*(/ contained
syntax match ronOperator /[-+*\/%]\|[<>=!]=\|[<>]\|\<\%(and\|or\|not\)\>-\@!/ contained
syntax cluster ronInFormula contains=ronVariable,ronFunction,ronOperator,ronNumber,ronUnit,ronConstant

syntax match ronComment /\/\/.*/ contains=ronTodo,@Spell
syntax region ronBlock start=/\/\*/ end=/\*\// contains=ronBlock,ronTodo,@Spell
syntax keyword ronTodo TODO FIXME XXX contained

highlight default link ronChoice Identifier
highlight default link ronNumber Number
highlight default link ronConstant Boolean
highlight default link ronType Type
highlight default link ronFile Structure
highlight default link ronKeyword Keyword
highlight default link ronUnit Special
highlight default link ronField Identifier
highlight default link ronAttribute PreProc
highlight default link ronEscape SpecialChar
highlight default link ronText String
highlight default link ronLetter Character
highlight default link ronKey Label
highlight default link ronColor Constant
highlight default link ronRaw String
highlight default link ronVariable Identifier
highlight default link ronFunction Function
highlight default link ronOperator Operator
highlight default link ronComment Comment
highlight default link ronBlock Comment
highlight default link ronTodo Todo

let b:current_syntax = "ron"
