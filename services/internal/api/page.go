package api

import (
	"bytes"
	"crypto/sha256"
	"embed"
	"encoding/hex"
	"io/fs"
	"net/http"
	"path"
	"strings"
	"time"

	"github.com/klauspost/compress/gzip"
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
	tags, zipped := make(map[string]string), make(map[string][]byte)
	err = fs.WalkDir(files, ".", func(name string, entry fs.DirEntry, err error) error {
		if err != nil || entry.IsDir() {
			return err
		}
		content, err := fs.ReadFile(files, name)
		sum := sha256.Sum256(content)
		tags["/"+name] = quoted(hex.EncodeToString(sum[:]))
		zipped["/"+name] = compressed(content)
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
		w.Header().Set("Vary", "Accept-Encoding")
		if strings.Contains(r.Header.Get("Accept-Encoding"), "gzip") {
			w.Header().Set("Content-Encoding", "gzip")
			http.ServeContent(w, r, name, time.Time{}, bytes.NewReader(zipped[name]))
			return
		}
		server.ServeHTTP(w, r)
	})
}

// compressed for browsers; a buffer does not fail.
func compressed(content []byte) []byte {
	var buffer bytes.Buffer
	writer := gzip.NewWriter(&buffer)
	_, _ = writer.Write(content)
	_ = writer.Close()
	return buffer.Bytes()
}
