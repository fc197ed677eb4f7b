package api

import (
	"crypto/sha256"
	"embed"
	"encoding/hex"
	"io/fs"
	"net/http"
	"path"
)

// The dashboard as built from the folder web of the repository; committed, so that building the
// coordinator does not need Node.
//
//go:embed all:web
var webFiles embed.FS

// dashboard serves the page. Files are few and fixed, so their tags are made once.
func dashboard() http.Handler {
	files, err := fs.Sub(webFiles, "web")
	if err != nil {
		panic(err) // the folder is compiled in
	}
	tags := make(map[string]string)
	err = fs.WalkDir(files, ".", func(name string, entry fs.DirEntry, err error) error {
		if err != nil || entry.IsDir() {
			return err
		}
		content, err := fs.ReadFile(files, name)
		sum := sha256.Sum256(content)
		tags["/"+name] = quoted(hex.EncodeToString(sum[:]))
		return err
	})
	if err != nil {
		panic(err)
	}
	server := http.FileServerFS(files)
	return http.HandlerFunc(func(w http.ResponseWriter, r *http.Request) {
		name := r.URL.Path
		if name == "/" {
			name = path.Join(name, "index.html")
		}
		tag, found := tags[name]
		if !found || (r.Method != http.MethodGet && r.Method != http.MethodHead) {
			writeProblem(w, http.StatusNotFound, "there is nothing at "+r.URL.Path)
			return
		}
		w.Header().Set("ETag", tag)
		server.ServeHTTP(w, r)
	})
}
